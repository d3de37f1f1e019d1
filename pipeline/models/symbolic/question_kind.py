"""What a question asks: told by the words it opens with and a few that stand anywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from pipeline.models.symbolic.phrases import Kind
from pipeline.models.symbolic.reading import AUXILIARY
from pipeline.models.symbolic.tagging import Token

_WHAT = frozenset({"what", "which", "whats"})
_NO_RULE = frozenset({"why", "when", "who", "whose"})
_WH = _WHAT | _NO_RULE | {"where", "how"}
_FIND = frozenset(
    {"find", "see", "spot", "leave", "left", "keep", "kept", "put", "locate", "look", "located", "place", "placed"}
) | {"know", "tell"}
"""Verbs with which "where" asks for a place even when somebody does something."""
_MAY = frozenset({"can", "could", "should", "would", "do", "might", "to"})
_PERSON = frozenset({"i", "we", "you", "one", "someone", "somebody", "me", "my", "us", "they"})
_NEED = frozenset({"use", "used", "go", "need", "want"})
_PLACE_TO = frozenset(
    {
        "next",
        "close",
        "closer",
        "closest",
        "near",
        "nearer",
        "nearest",
        "left",
        "right",
        "opposite",
        "adjacent",
        "compared",
    }
)
"""Words whose "to" leads to a place."""
_SOMETHING = frozenset({"something", "anything", "somewhere", "anywhere", "place", "way"})
_PAIRS = {
    "left right": ({"left"}, {"right"}),
    "above under": ({"above", "over", "higher"}, {"below", "under", "beneath", "underneath", "lower"}),
    "in front of behind": ({"front"}, {"behind"}),
    "on under": ({"on"}, {"under", "below", "beneath", "underneath"}),
}
"""Relations one is asked to choose from, and the words for each."""


@dataclass(frozen=True)
class _Asked:
    """A question's words as the rules below look at them."""

    words: tuple[str, ...]
    groups: Sequence[Token]

    @cached_property
    def text(self) -> str:
        return f" {' '.join(self.words)} "

    @cached_property
    def has(self) -> frozenset[str]:
        return frozenset(self.words)

    @cached_property
    def first(self) -> str:
        """First word of the last clause that asks: "I am cold. What can I use?" asks in the second."""
        starts = [i + 1 for i, group in enumerate(self.groups) if group.tag == "pause"]
        for start in [i for i in reversed(starts) if i < len(self.groups)]:
            word = self.groups[start].text.split()[0]
            if word in _WH:
                return word
        return self.words[0]

    @cached_property
    def extremes(self) -> list[Token]:
        """Words that single out the first by some measure."""
        return [g for g in self.groups if g.tag == "extreme" or g.value in ("nearest", "farthest")]

    @cached_property
    def states(self) -> frozenset[str]:
        return frozenset(group.value for group in self.groups if group.tag == "state")

    @cached_property
    def asks(self) -> bool:
        return self.first in _WH | AUXILIARY | {"on", "in"}

    def says(self, *phrases: str) -> bool:
        return any(f" {phrase} " in self.text for phrase in phrases)

    def opens(self, *phrases: str) -> bool:
        return any(self.text.startswith(f" {phrase} ") for phrase in phrases)

    @cached_property
    def to_do(self) -> bool:
        """Whether a "to" stands before something to be done, as in "something to read", not in "next to"."""
        pairs = zip(("", *self.words), self.words, strict=False)
        return any(word == "to" and before not in _PLACE_TO for before, word in pairs)

    def for_somebody(self, looking: frozenset[str]) -> bool:
        """Return whether somebody wants to do something other than to look for a thing."""
        for before, person, verb in zip(self.words, self.words[1:], (*self.words[2:], ""), strict=False):
            if before in _MAY and person in _PERSON:
                return verb not in looking
        return self.to_do and bool(_NEED & self.has)

    def names_early(self, groups: int) -> bool:
        return any(group.tag == "noun" for group in self.groups[:groups])

    def extreme_of_a_noun(self) -> bool:
        """Return whether a noun follows: "the shortest lamp" singles out a lamp, "the shortest thing" anything."""
        if not self.extremes or self.extremes[0].tag != "extreme":
            return False
        after = self.groups[list(self.groups).index(self.extremes[0]) + 1 :]
        return bool(after) and after[0].tag in ("noun", "color")

    @cached_property
    def pair(self) -> str:
        """The relations one may choose from: "left or right", "above or below"; empty for none."""
        if self.says("which side", "what side"):
            return "left right"
        if "or" not in self.has:
            return ""
        middle = self.words.index("or")
        before, after = set(self.words[:middle]), set(self.words[middle:])
        pairs = (
            pair
            for pair, (first, second) in _PAIRS.items()
            if (before & first and after & second) or (before & second and after & first)
        )
        return next(pairs, "")


_RULES: tuple[tuple[Kind, str, Callable[[_Asked], bool]], ...] = (
    ("side", "pair", lambda q: bool(q.pair)),
    ("unknown", "", lambda q: q.first in _NO_RULE),
    ("count", "", lambda q: q.says("how many", "number of") or q.opens("count")),
    ("color", "", lambda q: "color" in q.has and bool(_WHAT & q.has)),
    ("material", "", lambda q: bool(q.has & {"material", "made"}) and bool(q.has & _WHAT)),
    ("room", "", lambda q: q.says("what room", "which room")),
    ("same room", "", lambda q: q.says("same room", "one room")),
    ("purpose", "", lambda q: q.says("used for", "purpose of", "function of")),
    ("state", "", lambda q: q.says("state of", "status of") or ("or" in q.has and len(q.states) > 1)),
    ("compare", "extreme", lambda q: "or" in q.has and bool(q.extremes) and q.asks),
    ("where", "", lambda q: q.says("have you seen", "did you see")),
    ("use", "where", lambda q: q.first == "where" and q.for_somebody(_FIND)),
    ("where", "", lambda q: q.first == "where" or (q.first in AUXILIARY and "where" in q.has)),
    ("use", "can", lambda q: q.says("is it possible", "would it be possible")),
    ("use", "", lambda q: q.first in _WHAT and (q.for_somebody(frozenset({"find", "see"})) or q.says("there to"))),
    ("describe", "", lambda q: q.opens("i mean") or q.says("looking for", "look for the", "point out", "show me")),
    ("use", "", lambda q: q.first in {"how", "i", "im", "i'm", "we"} or (bool(q.has & {"i", "i'm"}) and not q.asks)),
    ("which", "extreme", lambda q: q.first in _WHAT and q.extreme_of_a_noun()),
    ("which", "extreme", lambda q: q.first == "which" and q.names_early(5)),
    ("identify", "", lambda q: q.first in _WHAT),
    ("use", "can", lambda q: q.first in AUXILIARY and q.to_do and bool(q.has & _SOMETHING)),
    ("exists", "", lambda q: q.opens("is there", "are there", "do you see", "can you see", "can i see", "is any")),
    ("exists", "", lambda q: q.first == "does" and "have" in q.has),
    ("use", "can", lambda q: q.first in _MAY and q.for_somebody(frozenset({"say", "see"}))),
    ("check", "", lambda q: q.first in AUXILIARY),
)
"""Rules in order: the kind, what its measure is taken from, and when it applies. The first that applies holds."""


def kind_of(words: tuple[str, ...], groups: Sequence[Token]) -> tuple[Kind, str]:
    """Return what is asked and the measure that goes with it; a sentence that asks nothing describes something.

    Args:
        words: Words of the question.
        groups: Its groups.
    """
    if not words:
        return "unknown", ""
    asked = _Asked(words, groups)
    for kind, measure, applies in _RULES:
        if applies(asked):
            taken = {"pair": asked.pair, "extreme": asked.extremes[0].value if asked.extremes else ""}
            return kind, taken.get(measure, measure)
    return "describe", ""
