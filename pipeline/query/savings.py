"""Calls not made because their outcome is known or a policy leaves them out: of which stage, why and how many."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

SINGLE_CANDIDATE = "single candidate"
"""A cluster with one view has nothing to choose from."""
EQUAL_ANSWERS = "equal answers"
"""Answers of the same text leave nothing to choose between, and get the same mark."""
EQUAL_PICTURES = "equal pictures"
"""Candidates that show the same picture leave nothing to choose between."""
SAME_VIEWS = "same views"
"""The final views are the initial ones: they get the same answer, and there is nothing to verify."""
ONE_IMAGE = "one image"
"""With one image there is none to name, and what it shows was said before."""
DEFINITE = "definite initial answer"
"""Policy `stop_when_definite`."""
REDUNDANT = "redundant view"
"""Policy `skip_redundant_views`."""


@dataclass(frozen=True, slots=True)
class Saved:
    """Calls of one stage that were not made for one reason."""

    stage: str
    """Stage, as in table `calls`."""
    reason: str
    """Why."""
    calls: int
    """How many, 1 or more, against asking everything."""

    def __str__(self) -> str:
        return f"{self.stage}: {self.reason}: {self.calls}"


class Savings:
    """The calls of one question that were not made."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()

    def add(self, stage: str, reason: str, calls: int = 1) -> None:
        """Count calls that were not made; 0 is no entry."""
        if calls:
            self._counts[stage, reason] += calls

    def entries(self) -> tuple[Saved, ...]:
        """Return what was counted, by stage and reason."""
        return tuple(Saved(stage, reason, calls) for (stage, reason), calls in sorted(self._counts.items()))
