"""Captures built on Ray: a task each, with as many CPU slots as it has threads, and a GPU where it asks for one."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import ray
from ray.exceptions import GetTimeoutError, RayError, RayTaskError

from schemas.build_plan import PlannedCapture
from workers.build_steps import Build, BuildWork, failed_build
from workers.dispatch import Ended
from workers.ray_backend import FETCH_S, KILL_S, lost_work, own_error
from workers.steps import Tables
from workers.watchdog import bounded


def _build_one(work: BuildWork, build: Build, capture: PlannedCapture) -> Ended:
    start = time.perf_counter()
    return Ended([build(work, capture, lambda: False)], time.perf_counter() - start)


# Retries are the ledger's (`dispatch.py`): Ray would run a killed task again unseen and uncounted.
_build = ray.remote(max_retries=0)(_build_one)


class BuildOnRay:
    """Builds captures on the Ray cluster this process is connected to (`ray_session.py`).

    Args:
        work: What the run needs.
        build: Builds one.
        gpus: GPUs of each capture.
    """

    def __init__(self, work: BuildWork, build: Build, *, gpus: int = 0) -> None:
        threads = str(work.threads)
        environment = {"NUMBA_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        self._options = {"num_cpus": work.threads, "num_gpus": gpus, "runtime_env": {"env_vars": environment}}
        self._work, self._build = ray.put(work), build

    def submit(self, unit: PlannedCapture, items: Sequence[PlannedCapture]) -> Any:
        """Start a capture; nothing here waits."""
        return _build.options(**self._options).remote(self._work, self._build, unit)

    def wait(self, handles: Sequence[Any], timeout_s: float) -> Sequence[Any]:
        """Return the captures that have ended, after one has or the time is over."""
        ended, _ = ray.wait(list(handles), num_returns=1, timeout=timeout_s, fetch_local=False)
        return ended

    def result(self, handle: Any) -> Ended:
        """Return what became of a capture, or raise what ended it as our own code raised it."""
        try:
            found: Ended = ray.get(handle, timeout=FETCH_S)
        except RayTaskError as error:
            raise own_error(error) from None
        except (GetTimeoutError, RayError) as error:
            raise lost_work(error) from None
        return found

    def cancel(self, handle: Any) -> None:
        """End a capture's process."""
        bounded(lambda: ray.cancel(handle, force=True), KILL_S)

    def forget(self, unit: PlannedCapture) -> None:
        """Drop what is held of a capture: nothing is."""

    def failed(self, item: PlannedCapture, error: Exception) -> Tables:
        """Return the records of a capture that could not be built."""
        return failed_build(item, error)
