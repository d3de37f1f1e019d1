"""The answer of one view."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.models.symbolic.certainty import CANNOT_TELL, Certainty


@dataclass(frozen=True, slots=True)
class Answer:
    """What one view says to a question."""

    text: str
    """The sentence."""
    certainty: Certainty
    """How sure it is."""
    support: float = 0.0
    """How well the view shows what the answer rests on: fit times prominence, 0 to 1."""
    content: str = ""
    """What was found, without the sentence around it: equal for answers that say the same."""
    count: int | None = None
    """Number found, for "how many"."""
    measure: float | None = None
    """Value by which "nearest" or "largest" orders what was found, smaller first."""
    room: str = ""
    """Room the thing was seen in, where that shows."""


UNKNOWN = Answer(CANNOT_TELL, Certainty.UNKNOWN)
