"""How many questions travel together and how many are in flight, from what those before them took.

A batch crosses the backend's steps as one, so what a step costs beside its work is paid once for all of it. It takes
about BATCH_S: cheap questions travel by the dozen, one that waits seconds for a model travels alone and holds up
nobody.
"""

from __future__ import annotations

from dataclasses import dataclass

BATCH_S = 0.5
"""Seconds that the steps of a batch should take; below it, starting them would cost more than a hundredth."""

MOST_TOGETHER = 50
"""Questions a batch at most: beyond it nothing is gained, and a lost worker would lose more."""

BATCHES_A_SLOT = 2
"""Batches a CPU slot at least: fewer would leave it idle while models are asked, or at a scene's end."""

RECENT = 0.2
"""Weight of the latest batch in the seconds a question takes."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of dispatch."""

    in_flight: int
    """Questions begun and not ended, at most."""
    timeout_s: float
    """Seconds a try may take, waiting for slots included."""
    retries: int
    """Tries after the first, for errors that may pass."""
    oom_tries: int = 2
    """Tries after which a question that is killed for want of memory is left alone."""
    drain_s: float = 60.0
    """Seconds that questions in flight get to end once the run is told to stop."""
    batch: int | None = None
    """Questions that travel together; None adapts it to BATCH_S."""
    batches: int | None = None
    """Batches begun and not ended, at most; None for any number within the other bounds."""
    slots: int = 1
    """CPU slots of the backend."""
    memory: int | None = None
    """Bytes that questions in flight may hold between their steps; None for any number."""


class Pace:
    """Sizes batches within limits.

    Args:
        limits: The bounds.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._seconds: float | None = None
        self._bytes = 0.0

    def learn(self, questions: int, seconds: float, held: int) -> None:
        """Take in what a batch took.

        Args:
            questions: Questions in it.
            seconds: What its steps took; those of questions that wait for models at once overlap.
            held: Bytes it held between steps.
        """
        each = seconds / questions
        self._seconds = each if self._seconds is None else (1 - RECENT) * self._seconds + RECENT * each
        # Up at once and down slowly: a few large questions in flight together are what would fill the store.
        self._bytes = max(held / questions, (1 - RECENT) * self._bytes + RECENT * held / questions)

    @property
    def window(self) -> int:
        """Questions that may be in flight, at least 1."""
        memory = self._limits.memory
        fit = self._limits.in_flight if memory is None or self._bytes == 0 else int(memory // self._bytes)
        return max(1, min(self._limits.in_flight, fit))

    @property
    def together(self) -> int:
        """Questions of the next batch, at most and at least 1."""
        if self._limits.batch is not None:
            return min(self._limits.batch, self.window)
        if self._seconds is None:
            return 1
        wanted = MOST_TOGETHER if self._seconds * MOST_TOGETHER <= BATCH_S else int(BATCH_S / self._seconds)
        return max(1, min(wanted, self.window // (BATCHES_A_SLOT * self._limits.slots)))

    def room(self, questions: int, batches: int) -> bool:
        """Return whether a further batch may begin while this many questions and batches are in flight."""
        if batches == 0:
            return True
        most = self._limits.batches
        return (most is None or batches < most) and questions + self.together <= self.window
