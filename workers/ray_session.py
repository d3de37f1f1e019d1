"""Starting or joining Ray, quietly, with thread settings that hold on every worker."""

from __future__ import annotations

import atexit
import logging
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from schemas.errors import StopError
from workers.watchdog import HeadLostError, HeadWatch, bounded

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("schemas", "pipeline", "workers")
"""What workers import, found in ROOT."""

REACH_S = 10.0
"""Seconds a cluster's head gets to accept a connection."""

WORKER_ENVIRONMENT = {
    # Ray sets OMP_NUM_THREADS itself, but numba would still take every core in every worker.
    "NUMBA_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "RAY_USAGE_STATS_ENABLED": "0",
}

QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    # Ray would print every error of a step whose result nobody fetched; dispatch fetches and records them all.
    "RAY_IGNORE_UNHANDLED_ERRORS": "1",
    # A worker killed because memory ran out is a matter for the ledger: Ray would start it again for ever.
    "RAY_task_oom_retries": "0",
}
"""Read by Ray when it is imported or started."""

SHUTDOWN_S = 20.0
"""Seconds a cluster gets to take leave of us: 7 measured where its head was killed, no end where it was stuck."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """The Ray cluster this process is connected to."""

    slots: int
    """CPUs it may use."""
    head: HeadWatch
    """Watch over its head."""


def _reach(address: str) -> None:
    """Refuse an address nobody listens at; Ray itself would try for minutes and then print a traceback."""
    place = urlsplit(address if "://" in address else f"//{address}")
    try:
        port = place.port
        if place.hostname is None or port is None:
            return
        socket.create_connection((place.hostname, port), timeout=REACH_S).close()
    except (OSError, ValueError) as error:
        raise StopError(f"no Ray cluster answers at {address}: {error}") from error


@contextmanager
def ray_session(*, cpus: int, address: str = "") -> Iterator[Cluster]:
    """Connect to Ray for a block and disconnect after it, even where its head has died meanwhile.

    Args:
        cpus: CPU slots of a local Ray started here; ignored with an address.
        address: An existing cluster, such as "auto" or "host:6379"; empty takes RAY_ADDRESS, as set for
            a job that was submitted to a cluster, or starts a local one.

    Raises:
        StopError: No cluster answers at the address, none starts here, or its head has died by the end of the block.
    """
    address = address or os.environ.get("RAY_ADDRESS", "")
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    import ray

    quiet: dict[str, Any] = {"logging_level": logging.ERROR, "log_to_driver": False}
    if address:
        # The cluster brings the libraries; our code goes with the job, so that workers run the planned version.
        _reach(address)
        code = {"py_modules": [str(ROOT / name) for name in PACKAGES], "excludes": ["**/__pycache__/**"]}
        try:
            ray.init(address=address, runtime_env={"env_vars": WORKER_ENVIRONMENT, **code}, **quiet)
        except ConnectionError as error:
            raise StopError(f"no Ray cluster answers at {address}: {str(error).splitlines()[0]}") from error
    else:
        # Workers do not inherit this process's import path.
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
        environment = {**WORKER_ENVIRONMENT, "PYTHONPATH": path}
        # "local": without it Ray joins whatever cluster it finds on this machine.
        try:
            ray.init(
                address="local", num_cpus=cpus, include_dashboard=False, runtime_env={"env_vars": environment}, **quiet
            )
        except Exception as error:  # Ray has no type of its own for a node that does not come up in time.
            ray.shutdown()
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise StopError(f"Ray does not start on this machine: {reason} (--in-process does without Ray)") from error
    ended_well = False
    try:
        slots = int(ray.cluster_resources().get("CPU", cpus))
        with HeadWatch(ray.nodes, f"the Ray cluster at {address}" if address else "the local Ray") as head:
            yield Cluster(slots, head)
        ended_well = True
    finally:
        if not bounded(ray.shutdown, SHUTDOWN_S):
            # The thread left behind would crash the interpreter on its way out; nothing is left to be done there.
            atexit.register(_end_at_once)
            if ended_well:
                raise HeadLostError("the head of the Ray cluster does not let go of this run")


def _end_at_once() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(1)
