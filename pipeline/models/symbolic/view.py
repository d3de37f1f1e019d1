"""What was seen in one view, and what was worked out and said of it since."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.models.symbolic.answer import Answer
from pipeline.models.symbolic.pairs import Pairs
from pipeline.models.symbolic.phrases import Query
from pipeline.models.symbolic.thing import Thing

ANSWERS = 4
"""Answers kept with a view: those of the questions in flight."""


@dataclass(frozen=True, slots=True)
class View:
    """All that is seen in one view."""

    things: tuple[Thing, ...]
    """Recognised things, largest first; walls, floor and ceiling are among them."""
    contacts: Mapping[tuple[int, int], float] = field(default_factory=dict)
    """(upper, lower) indices of things that touch, upper one over the lower in the image: share of the upper one's
    lower outline."""
    covers: Mapping[tuple[int, int], float] = field(default_factory=dict)
    """(front, back) indices of things of which one covers part of the other: share of the outline of the one behind."""
    _pairs: list[Pairs] = field(default_factory=list, init=False, compare=False, repr=False)
    """How the things stand to each other, once that was asked."""
    answers: deque[tuple[Query, Answer]] = field(
        default_factory=lambda: deque(maxlen=ANSWERS), compare=False, repr=False
    )
    """Latest answers, see `answer_view`: stages that compare views ask what was asked of each alone."""
    captions: dict[str, str] = field(default_factory=dict, compare=False, repr=False)
    """Descriptions that were given, of the view ("") or of a named object."""

    @property
    def pairs(self) -> Pairs:
        """How the things stand to each other, kept: questions ask for the same again."""
        if not self._pairs:
            self._pairs.append(Pairs(self.things, self.contacts))
        return self._pairs[0]

    def named(self, names: frozenset[str]) -> list[int]:
        """Return the indices of things that carry one of the names, largest first."""
        return [index for index, thing in enumerate(self.things) if thing.name in names]
