"""Which things of a view a noun phrase may mean, and how well each fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.models.symbolic.knowledge import ROOM_SIGNS, STRUCTURE, WEAK_SIGNS
from pipeline.models.symbolic.lexicon import NEAR_COLORS
from pipeline.models.symbolic.phrases import Link, Phrase
from pipeline.models.symbolic.relations import DEGREES, between, gap_m, gaps_m
from pipeline.models.symbolic.states import state_of
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View

SURE = 0.75
"""A fit from here on is stated without a hedge."""
POSSIBLE = 0.3
"""A fit below this is no match."""
COLOR_NEAR = 0.6
"""Fit of a colour that light may have turned into the one asked for."""
COLOR_WRONG = 0.1
RELATION_WRONG = 0.1
"""Fit left when a relation can be judged and does not hold: sentences are loose, so it is not nothing."""
UNSEEN = 0.5
"""Fit left when what it is related to is not in view: it may well be outside."""
STATE_UNKNOWN = 0.6
STATE_WRONG = 0.1
OTHER_KIND = 0.8
"""Fit of a neighbouring name, where none of the exact name is seen: a coffee table for "the table"."""
NOT_EXTREME = 0.3
"""Fit of all but the first where one is singled out ("the largest")."""
ALONE = 0.7
"""Fit of the only one in view where one is singled out of several: there is nothing to compare it with."""
OTHER_ROOM = 0.2
"""Fit when the view shows several signs of other rooms and none of the one named."""
NO_SIGN = 0.7
"""Fit when the view does not show what room it is."""
UNCERTAIN = 0.7
"""Fit of a thing that is recognised without certainty."""
SAME_ROOM_M = 3.0
"""Signs of a room count for things this close: rooms are about this large."""
MAX_DEPTH = 3
"""Anchors of anchors followed this far."""
_ANY_SIGN = frozenset[str]().union(*ROOM_SIGNS.values())
_ROOMS_OF = {kind: tuple(room for room, signs in ROOM_SIGNS.items() if kind in signs) for kind in _ANY_SIGN}


@dataclass(frozen=True, slots=True)
class Match:
    """A thing and how well it fits a phrase."""

    index: int
    """Index of the thing in its view."""
    fit: float
    """0 to 1."""
    measure: float | None = None
    """Value by which "nearest", "largest" and the like order things, smaller first; None without such a word."""


def candidates(phrase: Phrase, view: View) -> list[int]:
    """Return the things that carry a name of the phrase; for an unnamed one, all but parts of the building."""
    if phrase.anything:
        return [index for index, thing in enumerate(view.things) if thing.kind not in STRUCTURE]
    return view.named(phrase.exact) or view.named(phrase.kinds)


def resolve(phrase: Phrase, view: View, depth: int = 0) -> list[Match]:
    """Return the things a phrase may mean, best first; equal fits go to the more prominent thing.

    Args:
        phrase: What is named.
        view: Where it is looked for.
        depth: How many links led here.
    """
    found = []
    ends = [_ends(link, view, depth) for link in phrase.links] if depth < MAX_DEPTH else []
    for index in candidates(phrase, view):
        thing = view.things[index]
        fit = 1.0 if thing.clear else UNCERTAIN
        if not phrase.anything and thing.name not in phrase.exact:
            fit *= OTHER_KIND
        fit *= (
            _color_fit(phrase.colors, thing)
            * _state_fit(phrase.state, view, index)
            * _room_fit(phrase.room, view, index)
        )
        measure = None
        for link, (anchors, others) in zip(phrase.links, ends, strict=False):
            degree, distance = _link_fit(link, view, index, anchors, others)
            fit *= degree
            measure = distance if distance is not None else measure
        if phrase.extreme:
            measure = extent(phrase.extreme, thing)
        found.append(Match(index, fit, measure))
    found = _single_out(found)
    found = _size_up(found, phrase.sizes, view)
    found.sort(key=lambda match: (-round(match.fit, 6), -prominence(view.things[match.index]), match.index))
    return [match for match in found if match.fit >= POSSIBLE * (1.0 if depth == 0 else 0.5)]


def prominence(thing: Thing) -> float:
    """Return how much a thing is the subject of its view: large, near the middle and whole."""
    off = max(abs(thing.center[0] - 0.5), abs(thing.center[1] - 0.5))
    return float(thing.share**0.5 * (1.0 - off) * (0.6 if thing.cut else 1.0))


def extent(extreme: str, thing: Thing) -> float:
    """Return the measure of "largest", "tallest" and so on, the first of its kind being smallest."""
    width, height = float(max(thing.size[0], thing.size[2])), float(thing.size[1])
    volume = float(thing.size[0] + thing.size[2]) * (height + 0.1)
    measures = {
        "large": -volume,
        "small": volume,
        "tall": -height,
        "low": height,
        "wide": -width,
        "narrow": width,
        "high": -float(thing.high[1]),
        "deep": float(thing.low[1]),
        "leftmost": float(thing.middle[0]),
        "rightmost": -float(thing.middle[0]),
        "nearest": thing.distance,
        "farthest": -thing.distance,
    }
    return measures[extreme]


def room_of(view: View, index: int | None = None) -> str:
    """Return the room most signs point to, or "" where there is none or a tie.

    Args:
        view: The view.
        index: The thing whose room is asked for; None for what the view shows most of.
    """
    votes = dict.fromkeys(ROOM_SIGNS, 0.0)
    for thing in _about(view, index):
        for room in _ROOMS_OF.get(thing.kind, ()):
            votes[room] += (0.5 if thing.kind in WEAK_SIGNS else 1.0) + thing.share
    best = sorted(votes.items(), key=lambda item: -item[1])
    return best[0][0] if best[0][1] > best[1][1] else ""


def room_signs(view: View, room: str, index: int | None = None) -> int:
    """Return how many different kinds of things point to a room, about one thing or in the whole view."""
    return len({thing.kind for thing in _about(view, index)} & ROOM_SIGNS.get(room, frozenset()))


def _about(view: View, index: int | None) -> Sequence[Thing]:
    """Through a doorway one sees another room: what is far from a thing says nothing of where it is."""
    if index is None:
        return view.things
    gaps = gaps_m(view, index)
    return [thing for thing, gap in zip(view.things, gaps, strict=True) if gap <= SAME_ROOM_M]


def _color_fit(colors: Sequence[str], thing: Thing) -> float:
    """One of the colours is enough: "white and green" things show mostly one of them from most sides."""
    if not colors or thing.color in colors:
        return 1.0
    if thing.second_color in colors:
        return 0.9
    return COLOR_NEAR if any(frozenset((thing.color, c)) in NEAR_COLORS for c in colors) else COLOR_WRONG


def _state_fit(state: str, view: View, index: int) -> float:
    if not state:
        return 1.0
    seen = state_of(view, index, state)
    if seen is None:
        return STATE_UNKNOWN
    return 1.0 if seen.value == state else STATE_WRONG


def _room_fit(room: str, view: View, index: int) -> float:
    """One sign of the room will do; without, signs of others speak against it. A room without signs is not judged."""
    if room not in ROOM_SIGNS or room_signs(view, room, index):
        return 1.0
    others = len({thing.kind for thing in _about(view, index)} & _ANY_SIGN)
    return OTHER_ROOM if others > 1 else NO_SIGN


def _ends(link: Link, view: View, depth: int) -> tuple[list[Match], list[Match]]:
    """Return what a link may lead to, and the second end of "between"."""
    anchors = resolve(link.anchor, view, depth + 1)
    if link.relation != "between" or link.other is None:
        return anchors, anchors
    return anchors, resolve(link.other, view, depth + 1)


def _link_fit(
    link: Link, view: View, index: int, ends: Sequence[Match], others: Sequence[Match]
) -> tuple[float, float | None]:
    """Return how well a thing stands to the best anchor, and its distance where that is asked for."""
    anchors = [m for m in ends if m.index != index]
    if not anchors:
        return UNSEEN, None
    if link.relation == "between":
        pairs = [(b.index, c.index) for b in anchors for c in others if len({b.index, c.index, index}) == 3]
        if not pairs:
            return UNSEEN, None
        return max(RELATION_WRONG, *(between(view, index, b, c) for b, c in pairs)), None
    if link.relation in ("nearest", "farthest"):
        distance = min(gap_m(view, index, a.index) for a in anchors)
        return 1.0, distance if link.relation == "nearest" else -distance
    relation = DEGREES[link.relation]
    degree = max(relation(view, index, anchor.index) * min(1.0, anchor.fit / SURE) for anchor in anchors)
    return max(RELATION_WRONG, degree), None


def _single_out(found: list[Match]) -> list[Match]:
    measured = [m.measure for m in found if m.measure is not None and m.fit >= POSSIBLE]
    if not measured:
        return found
    if len(measured) == 1:
        return [Match(m.index, m.fit * ALONE, m.measure) for m in found]
    best = min(measured)
    return [Match(m.index, m.fit * (1.0 if m.measure == best else NOT_EXTREME), m.measure) for m in found]


def _size_up(found: list[Match], sizes: Sequence[str], view: View) -> list[Match]:
    """Sizes are relative to the others of the name in view; with nothing to compare they tell nothing."""
    if not sizes or len(found) < 2:
        return found
    for size in sizes:
        order = sorted(found, key=lambda m: extent(size, view.things[m.index]))
        half = {m.index for m in order[: (len(order) + 1) // 2]}
        found = [Match(m.index, m.fit * (1.0 if m.index in half else 0.7), m.measure) for m in found]
    return found
