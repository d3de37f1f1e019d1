"""Starting or joining Ray, quietly, with thread settings that hold on every worker."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from schemas.errors import StopError

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
}
"""Read by Ray when it is imported."""


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
def ray_session(*, cpus: int, address: str = "") -> Iterator[int]:
    """Connect to Ray for a block and disconnect after it; gives the CPUs it may use.

    Args:
        cpus: CPU slots of a local Ray started here; ignored with an address.
        address: An existing cluster, such as "auto" or "host:6379"; empty starts a local one.

    Raises:
        StopError: No cluster answers at the address.
    """
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
        ray.init(num_cpus=cpus, include_dashboard=False, runtime_env={"env_vars": environment}, **quiet)
    try:
        yield int(ray.cluster_resources().get("CPU", cpus))
    finally:
        ray.shutdown()
