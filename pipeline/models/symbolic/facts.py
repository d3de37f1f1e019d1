"""Reading descriptions back: what the symbolic captions and the lists of objects say, sentence by sentence.

The sentences are those of `caption.py` and of the baselines' lists. Others are passed over: this is no reader of
free text.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from pipeline.models.symbolic.lexicon import OPPOSITE
from pipeline.models.symbolic.words import number, singular
from pipeline.scene.color_names import COLOR_NAMES

_COLORS = "|".join(COLOR_NAMES)
_PLACES = "in|on|under|behind|above|next to"
_THING = re.compile(
    rf"(?:On the left|On the right|In the middle|There) (?:is|are) (?P<doubt>what looks like )?(?:an? )?"
    rf"(?P<colors>(?:(?:{_COLORS})(?: and (?:{_COLORS}))? )?)(?P<name>[\w' -]+?)"
    rf"(?: (?P<place>{_PLACES}) the (?P<anchor>[\w' -]+))?(?P<rest>(?:, [\w ]+)*)"
)
_LIST = re.compile(r"Also seen: (.+)")
_ITEM = re.compile(r"(?P<count>an?|\d+) (?P<name>[\w' -]+)")
_ROOM = re.compile(r"This is the ([\w -]+)")
_RELATED = re.compile(rf"It is (?P<place>{_PLACES}) the (?P<anchor>[\w' -]+?)(?: \(object \d+\))?")
_SENTENCE = re.compile(r"(?<=\.)\s+(?=[A-Z])")


@dataclass(frozen=True, slots=True)
class Fact:
    """One thing that is described."""

    note: int
    """Description it stands in."""
    name: str
    """What it is called."""
    colors: tuple[str, ...] = ()
    """Its colours, the main one first."""
    places: tuple[tuple[str, str], ...] = ()
    """How it stands to other things: relation and their names."""
    states: frozenset[str] = field(default_factory=frozenset)
    """open, closed, on or off."""
    clear: bool = True
    """Said without a doubt."""
    room: str = ""
    """Room of its description."""


def read_facts(notes: Sequence[str]) -> list[Fact]:
    """Return the things that descriptions speak of, in their order.

    Args:
        notes: Descriptions, each of one picture or of one object.
    """
    return [fact for number, note in enumerate(notes) for fact in _read(number, note)]


def _read(note: int, text: str) -> list[Fact]:
    facts: list[Fact] = []
    room = ""
    for sentence in _SENTENCE.split(text.strip()):
        plain = sentence.strip().rstrip(".")
        # An object's line opens with its number and name.
        plain = plain.partition(": ")[2] if plain.startswith("Object ") else plain
        if match := _ROOM.fullmatch(plain):
            room = match.group(1)
        elif match := _THING.fullmatch(plain):
            facts.append(_thing(note, match))
        elif (match := _RELATED.fullmatch(plain)) and facts:
            places = (*facts[-1].places, (match["place"], match["anchor"]))
            facts[-1] = replace(facts[-1], places=tuple(dict.fromkeys(places)))
        elif match := _LIST.fullmatch(plain):
            facts += [fact for item in re.split(r", | and ", match.group(1)) for fact in _items(note, item)]
    return [replace(fact, room=room) for fact in facts]


def _thing(note: int, match: re.Match[str]) -> Fact:
    words = match["rest"].replace(",", " ").split()
    return Fact(
        note,
        match["name"],
        tuple(match["colors"].replace(" and ", " ").split()),
        ((match["place"], match["anchor"]),) if match["place"] else (),
        frozenset(word for word in words if word in OPPOSITE),
        match["doubt"] is None,
    )


def _items(note: int, text: str) -> list[Fact]:
    match = _ITEM.fullmatch(text)
    if match is None:
        return [Fact(note, text)]
    count = number(match["count"]) or 1
    name = match["name"] if count == 1 else " ".join(map(singular, match["name"].split()))
    return [Fact(note, name)] * count
