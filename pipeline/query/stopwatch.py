"""Seconds by stage: what every stage of a question reports beside its result."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class StageTime:
    """How long one stage took."""

    stage: str
    """Stage, as in table `timings`."""
    seconds: float
    """Wall seconds."""
    count: int
    """Items handled."""
    whole_scene: bool = False
    """Work done once for the scene, whichever question came first."""


class Stopwatch:
    """Collects the times of one question's stages, in the order in which they first ended; repeats add up."""

    def __init__(self) -> None:
        self._times: dict[tuple[str, bool], StageTime] = {}

    @contextmanager
    def stage(self, name: str, count: int = 0, *, whole_scene: bool = False) -> Iterator[None]:
        """Time the block as one stage that handled `count` items; also when it raises."""
        start = time.perf_counter()
        try:
            yield
        finally:
            old = self._times.get((name, whole_scene), StageTime(name, 0.0, 0, whole_scene))
            seconds = old.seconds + time.perf_counter() - start
            self._times[name, whole_scene] = StageTime(name, seconds, old.count + count, whole_scene)

    def times(self) -> tuple[StageTime, ...]:
        """Return what was timed so far."""
        return tuple(self._times.values())
