"""What a question is made of once it is read: noun phrases, the links between them, and the kind of question."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "count",
    "color",
    "where",
    "identify",
    "exists",
    "check",
    "state",
    "compare",
    "which",
    "use",
    "purpose",
    "room",
    "material",
    "side",
    "same room",
    "describe",
    "unknown",
]
"""What is asked.

count: how many; color: what colour; where: the place of a named thing; identify: an unnamed thing at a named place;
exists: is there one; check: does what is said of a thing hold; state: open or closed, on or off; compare: which of two
named things; which: which one of several of a name; use: what serves a purpose; purpose: what a thing serves;
room: which room; material: made of what; side: left or right; same room: are two things in one; describe: a sentence
that describes a thing.
"""


@dataclass(frozen=True, slots=True)
class Phrase:
    """A noun with all that is said of it."""

    words: str
    """The noun as the question has it; empty for an unnamed thing."""
    exact: frozenset[str] = frozenset()
    """Category names it stands for."""
    kinds: frozenset[str] = frozenset()
    """Narrower or neighbouring names, used where no exact one is seen."""
    colors: tuple[str, ...] = ()
    """Basic colour names."""
    sizes: tuple[str, ...] = ()
    """Sizes said of it: large, small, tall, low, wide, narrow."""
    state: str = ""
    """State said of it."""
    extreme: str = ""
    """Measure by which it is the first of its kind: large, small, tall, high, ..."""
    plural: bool = False
    """Several are meant."""
    room: str = ""
    """Room it is said to be in."""
    links: tuple[Link, ...] = ()
    """How it stands to other things."""

    @property
    def named(self) -> bool:
        """Whether the vocabulary has a name for it."""
        return bool(self.exact or self.kinds)

    @property
    def anything(self) -> bool:
        """Whether it stands for a thing of any name."""
        return not self.words


@dataclass(frozen=True, slots=True)
class Link:
    """How a thing stands to another."""

    relation: str
    """A value of `lexicon.RELATIONS`."""
    anchor: Phrase
    """The other thing."""
    other: Phrase | None = None
    """The second other thing of "between"."""


@dataclass(frozen=True, slots=True)
class Query:
    """A question as the rules understand it."""

    kind: Kind
    """What is asked."""
    target: Phrase
    """What it is asked of."""
    options: tuple[Phrase, ...] = ()
    """The things or values to choose from."""
    measure: str = ""
    """What "compare" compares, and what "use" and "purpose" look for."""
    reference: Phrase | None = None
    """What nearness is measured to in "compare", None for the camera; what a thing is placed by in "side"."""
    said: tuple[str, ...] = ()
    """Colours said of the target after a verb: "is the chair blue"."""
    words: tuple[str, ...] = ()
    """All words of the question but names of rooms, which say where and not what."""


NOTHING = Phrase("")
