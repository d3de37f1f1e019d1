"""Captures built in this process, one after the other, in a thread of their own: the driver goes on looking about."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from threading import Event

from schemas.build_plan import PlannedCapture
from workers.build_steps import Build, BuildWork, failed_build
from workers.dispatch import Ended
from workers.steps import Tables


class BuildHere:
    """Builds captures in the calling process.

    Args:
        work: What the run needs.
        build: Builds one.
    """

    def __init__(self, work: BuildWork, build: Build) -> None:
        self._work, self._build = work, build
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="build")
        self._given_up: dict[Future[Ended], Event] = {}

    def submit(self, unit: PlannedCapture, items: Sequence[PlannedCapture]) -> Future[Ended]:
        """Start a capture."""
        given_up = Event()
        handle = self._pool.submit(self._built, unit, given_up)
        self._given_up[handle] = given_up
        return handle

    def _built(self, unit: PlannedCapture, given_up: Event) -> Ended:
        start = time.perf_counter()
        return Ended([self._build(self._work, unit, given_up.is_set)], time.perf_counter() - start)

    def wait(self, handles: Sequence[Future[Ended]], timeout_s: float) -> Sequence[Future[Ended]]:
        """Return the captures that have ended, after one has or the time is over."""
        return tuple(wait_for(handles, timeout_s, FIRST_COMPLETED).done)

    def result(self, handle: Future[Ended]) -> Ended:
        """Return what became of a capture, or raise what ended it."""
        self._given_up.pop(handle, None)
        return handle.result()

    def cancel(self, handle: Future[Ended]) -> None:
        """Give up a capture; it ends when it next looks."""
        handle.cancel()
        self._given_up[handle].set()

    def forget(self, unit: PlannedCapture) -> None:
        """Drop what is held of a capture: nothing is."""

    def failed(self, item: PlannedCapture, error: Exception) -> Tables:
        """Return the records of a capture that could not be built."""
        return failed_build(item, error)

    def close(self) -> None:
        """Give up what is under way and wait for it."""
        for given_up in self._given_up.values():
            given_up.set()
        self._pool.shutdown(wait=True, cancel_futures=True)
