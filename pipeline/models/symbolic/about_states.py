"""Answers about how things are: whether what is said of one holds, open or closed, which is larger, left or right."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.models.symbolic.about_things import exists
from pipeline.models.symbolic.answer import UNKNOWN, Answer
from pipeline.models.symbolic.answering import stated, verdict
from pipeline.models.symbolic.knowledge import MATERIALS
from pipeline.models.symbolic.lexicon import NEAR_COLORS
from pipeline.models.symbolic.phrases import Phrase, Query
from pipeline.models.symbolic.relations import DEGREES, gap_m
from pipeline.models.symbolic.resolve import SURE, Match, extent, resolve
from pipeline.models.symbolic.sentences import be, link_words, named, place_of
from pipeline.models.symbolic.states import state_of
from pipeline.models.symbolic.view import View

HOLDS = 0.6
"""Fit from which what is said of a thing holds."""
PLAINLY_APART_M = 0.15
"""Difference in height from which on one thing is above or below another."""
PLAINLY_ASIDE = 0.25
"""Sine of the angle off the line of sight from which on a thing is to one's left or right."""
CLEARLY_DIFFERENT = 0.15
"""Two measures closer than this share of the larger are too close to call for sure."""


def check(query: Query, view: View) -> Answer:
    """Look for the thing without what is asked of it, then see whether that holds."""
    target = query.target
    if target.anything or not target.named:
        return exists(query, view)
    if target.state:
        return _check_state(target, view)
    if query.said:
        return _check_color(query, view)
    return _check_place(target, view) if target.links else UNKNOWN


def state(query: Query, view: View) -> Answer:
    """Name the state of a thing on the scale asked about, or on the first that shows."""
    found = resolve(replace(query.target, state=""), view)
    if not found:
        return UNKNOWN
    scales = query.measure.split()[:1] or ["open", "on"]
    seen = next((s for scale in scales if (s := state_of(view, found[0].index, scale)) is not None), None)
    if seen is None:
        return UNKNOWN
    name = query.target.words or view.things[found[0].index].name
    sure = seen.sure and found[0].fit >= SURE
    return stated(f"The {name} {be(query.target)} {seen.value}.", sure, view, found[0], seen.value)


def compare(query: Query, view: View) -> Answer:
    """Say which of two is nearer or larger; both must be seen, and what nearness is measured to."""
    taken = [found for option in query.options if (found := measure_option(query, option, view)) is not None]
    if len(taken) < max(2, len(query.options)):
        return UNKNOWN
    best = min(range(len(taken)), key=lambda i: (taken[i].measure, i))
    rest = min(found.measure for i, found in enumerate(taken) if i != best)
    whole = all(found.match.fit >= SURE and not view.things[found.match.index].cut for found in taken)
    phrase = query.options[best]
    sure = whole and clearly(taken[best].measure, rest)
    return stated(f"The {named(phrase)}.", sure, view, taken[best].match, phrase.words)


@dataclass(frozen=True, slots=True)
class Measured:
    """One of the things that are compared."""

    measure: float
    """Value by which it is compared, smaller first."""
    match: Match
    """Where it was seen."""


def measure_option(query: Query, option: Phrase, view: View) -> Measured | None:
    """Return the measure by which an option is compared; None where it cannot be taken in this view."""
    found = resolve(replace(option, links=(), extreme=""), view)
    if not found:
        return None
    thing = view.things[found[0].index]
    if query.measure not in ("nearest", "farthest") or query.reference is None:
        return Measured(extent(query.measure, thing), found[0])
    anchors = [m for m in resolve(query.reference, view, 1) if m.index != found[0].index]
    if not anchors:
        return None
    distance = min(gap_m(view, found[0].index, anchor.index) for anchor in anchors)
    return Measured(distance if query.measure == "nearest" else -distance, found[0])


def clearly(first: float, second: float) -> bool:
    """Return whether two measures differ by more than the eye errs."""
    return abs(second - first) > CLEARLY_DIFFERENT * max(abs(first), abs(second))


def material(query: Query, view: View) -> Answer:
    """Guess what a thing is made of from what such things are made of."""
    found = resolve(query.target, view)
    guess = MATERIALS.get(view.things[found[0].index].kind, "") if found else ""
    if not guess:
        return UNKNOWN
    return stated(f"The {query.target.words} {be(query.target)} made of {guess}.", False, view, found[0], guess)


def side(query: Query, view: View) -> Answer:
    """Choose between two opposite relations of a thing to another, as this view shows them.

    With a third thing given, left and right are those of someone at the second who faces the third.
    """
    anchor = query.reference
    found = resolve(query.target, view)
    anchors = [m for m in resolve(anchor, view, 1) if m.index != found[0].index] if anchor and found else []
    if anchor is None or not anchors:
        return UNKNOWN
    first, second = found[0].index, anchors[0].index
    pair = ("in front of", "behind") if query.measure == "in front of behind" else tuple(query.measure.split())
    faced = [m for m in resolve(query.options[0], view, 1) if m.index != first] if query.options else []
    if query.options:
        if not faced or pair != ("left", "right"):
            return UNKNOWN
        seen = _side_of_someone(view, second, faced[0].index, first)
    else:
        seen = next((relation for relation in pair if _holds(view, relation, first, second)), "")
    if not seen:
        return UNKNOWN
    sure = found[0].fit >= SURE and anchors[0].fit >= SURE and not query.options
    place = f"on the {seen} of" if seen in ("left", "right") else seen
    sentence = f"The {query.target.words} {be(query.target)} {place} the {anchor.words}."
    return stated(sentence, sure, view, found[0], seen)


def _holds(view: View, relation: str, first: int, second: int) -> bool:
    """Where only above and below are in question, height alone decides."""
    apart = float(view.things[first].middle[1] - view.things[second].middle[1])
    if relation in ("above", "under") and abs(apart) > PLAINLY_APART_M:
        return (apart > 0) == (relation == "above")
    return DEGREES[relation](view, first, second) >= HOLDS


def _side_of_someone(view: View, at: int, facing: int, thing: int) -> str:
    """Return on which side of someone at one thing, who faces another, a third is; "" where it is nearly ahead."""
    origin = view.things[at].middle[[0, 2]]
    ahead, toward = view.things[facing].middle[[0, 2]] - origin, view.things[thing].middle[[0, 2]] - origin
    across = float(toward[0] * ahead[1] - toward[1] * ahead[0])
    if abs(across) < PLAINLY_ASIDE * float(np.linalg.norm(ahead) * np.linalg.norm(toward)):
        return ""
    return "right" if across > 0 else "left"


def _check_state(target: Phrase, view: View) -> Answer:
    found = resolve(replace(target, state=""), view)
    seen = state_of(view, found[0].index, target.state) if found else None
    if seen is None:
        return UNKNOWN
    word = "Yes" if seen.value == target.state else "No"
    sentence = f"the {target.words} {be(target)} {seen.value}"
    return verdict(word, sentence, seen.sure and found[0].fit >= SURE, view, found[0])


def _check_color(query: Query, view: View) -> Answer:
    target = query.target
    found = resolve(replace(target, colors=tuple(c for c in target.colors if c not in query.said)), view)
    if not found:
        return UNKNOWN
    seen = view.things[found[0].index].color
    word = "Yes" if seen in query.said else "No"
    doubtful = word == "No" and any(frozenset((seen, c)) in NEAR_COLORS for c in query.said)
    sentence = f"the {target.words} {be(target)} {seen}"
    return verdict(word, sentence, found[0].fit >= SURE and not doubtful, view, found[0])


def _check_place(target: Phrase, view: View) -> Answer:
    """The last relation is the one asked about; it is denied only where both things are seen."""
    found = resolve(target, view)
    if found and found[0].fit > HOLDS:
        return verdict(
            "Yes", f"the {target.words} {be(target)} {link_words(target)}", found[0].fit >= SURE, view, found[0]
        )
    asked = target.links[-1]
    base = resolve(replace(target, links=target.links[:-1]), view)
    if not base or not resolve(asked.anchor, view, 1):
        return UNKNOWN
    place = place_of(view, base[0].index)
    words = place[0] if place else f"not {link_words(replace(target, links=(asked,)))}"
    return verdict("No", f"the {target.words} {be(target)} {words}", base[0].fit >= SURE and bool(place), view, base[0])
