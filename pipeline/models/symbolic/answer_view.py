"""Answering a question from one view: a definite sentence, a hedged one, or that the view does not tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from pipeline.models.symbolic.certainty import CANNOT_TELL, Certainty
from pipeline.models.symbolic.knowledge import MATERIALS, ROOM_SIGNS
from pipeline.models.symbolic.lexicon import NEAR_COLORS
from pipeline.models.symbolic.perceive import View
from pipeline.models.symbolic.phrases import Kind, Link, Phrase, Query
from pipeline.models.symbolic.relations import gap_m, left
from pipeline.models.symbolic.resolve import SURE, Match, extent, prominence, resolve, room_of
from pipeline.models.symbolic.sentences import be, hedged, link_words, listed, place_of, plural, said, with_article
from pipeline.models.symbolic.states import state_of
from pipeline.models.symbolic.uses import purpose_of, useful_names
from pipeline.models.symbolic.words import number, number_word, singular

SEVERAL = frozenset({"on", "in", "under"})
"""Relations that several things may stand in at once; of the others the nearest thing is meant."""
MOST_LISTED = 3
"""Things named at most in one answer: a list of all one sees is no answer."""
CLEARLY_DIFFERENT = 0.15
"""Two measures closer than this share of the larger are too close to call for sure."""
SIGNS_NEEDED = 2
"""Things that must point to a room to be sure of it."""


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


UNKNOWN = Answer(CANNOT_TELL, Certainty.UNKNOWN)


def answer_view(query: Query, view: View) -> Answer:
    """Return the answer of one view.

    Args:
        query: The question, read.
        view: What is seen.
    """
    return _ANSWERS[query.kind](query, view)


def _answer(sentence: str, sure: bool, view: View, match: Match, content: str) -> Answer:
    return Answer(
        hedged(sentence, sure),
        Certainty.DEFINITE if sure else Certainty.HEDGED,
        match.fit * prominence(view.things[match.index]),
        content,
        measure=match.measure,
    )


def _unseen(query: Query, view: View, sentence: str) -> Answer:
    """Return that a thing is not seen, or that one cannot tell where its surroundings are not in view either."""
    anchors = [end for link in query.target.links for end in (link.anchor, link.other) if end is not None]
    if not all(resolve(anchor, view, 1) for anchor in anchors):
        return UNKNOWN
    if query.target.room and room_of(view) != query.target.room:
        return UNKNOWN
    support = sum(prominence(view.things[resolve(anchor, view, 1)[0].index]) for anchor in anchors)
    return Answer(sentence, Certainty.UNSEEN, support, "no")


def _color(query: Query, view: View) -> Answer:
    found = resolve(query.target, view)
    if not found:
        return UNKNOWN
    thing = view.things[found[0].index]
    rivals = {view.things[m.index].color for m in found if m.fit > 0.9 * found[0].fit}
    sure = found[0].fit >= SURE and (len(rivals) == 1 or query.target.plural)
    return _answer(
        f"The {said(query.target, thing.name)} {be(query.target)} {thing.color}.", sure, view, found[0], thing.color
    )


def _count(query: Query, view: View) -> Answer:
    found = [m for m in resolve(query.target, view) if m.fit > 0.5]
    noun = query.target.words or "thing"
    if not found:
        return _unseen(query, view, f"I do not see any {noun}.")
    n = len(found)
    name = view.things[found[0].index].name if not query.target.words else noun
    words = (
        f"There is {number_word(1)} {singular(name)}"
        if n == 1
        else f"There are {number_word(n)} {plural(singular(name))}"
    )
    answer = _answer(f"{words}.", found[0].fit >= SURE, view, found[0], str(n))
    return replace(answer, count=n)


def _where(query: Query, view: View) -> Answer:
    found = resolve(query.target, view)
    if not found:
        return UNKNOWN
    index = found[0].index
    name = said(query.target, view.things[index].name)
    place = place_of(view, index, without=query.target.exact | query.target.kinds)
    if place is None:
        room = room_of(view)
        return (
            _answer(f"The {name} {be(query.target)} in the {room}.", False, view, found[0], room) if room else UNKNOWN
        )
    words, sure = place
    sentence = f"The {name} {be(query.target)} {words}."
    return _answer(sentence, sure and found[0].fit >= SURE, view, found[0], words)


def _identify(query: Query, view: View) -> Answer:
    target = query.target
    if not (target.links or target.colors or target.extreme or target.named):
        return UNKNOWN
    found = [m for m in resolve(target, view) if m.fit > 0.5]
    if not found:
        where = link_words(target)
        return _unseen(query, view, f"I do not see anything {where}." if where else "I do not see such a thing.")
    relation = target.links[0].relation if target.links else ""
    if relation in SEVERAL and not target.colors and not target.extreme:
        best = [m for m in found if m.fit > 0.9 * found[0].fit][:MOST_LISTED]
    elif relation and not target.extreme:
        best = sorted((m for m in found if m.fit > 0.9 * found[0].fit), key=lambda m: _anchor_gap(target, view, m))[:1]
    else:
        best = found[:1]
    names = [view.things[m.index].name for m in best]
    verb = "is" if len(names) == 1 else "are"
    sentence = f"There {verb} {listed(names)}{' ' if target.links else ''}{link_words(target)}."
    sure = all(view.things[m.index].clear for m in best) and best[0].fit >= SURE
    return _answer(sentence, sure, view, best[0], " ".join(sorted(names)))


def _anchor_gap(target: Phrase, view: View, match: Match) -> tuple[float, int]:
    anchors = [m for m in resolve(target.links[0].anchor, view, 1) if m.index != match.index]
    return min(gap_m(view.things[match.index], view.things[a.index]) for a in anchors), match.index


def _exists(query: Query, view: View) -> Answer:
    target = query.target
    found = resolve(target, view)
    noun = _described(target)
    wanted = _wanted_number(query)
    if wanted is not None:
        n = sum(m.fit > 0.5 for m in found)
        if n < wanted:
            return _unseen(query, view, f"No, I do not see that many {target.words}.")
        return _answer(f"Yes, there are {number_word(n)} {target.words}.", True, view, found[0], "yes")
    if found and found[0].fit > 0.5:
        name = target.words or view.things[found[0].index].name
        sentence = f"there {be(target)} {name if target.plural else with_article(name)}{_and(link_words(target))}."
        sure = found[0].fit >= SURE
        words = f"Yes, {sentence}" if sure else f"Yes, it looks like {sentence}"
        return replace(
            _answer(words, True, view, found[0], "yes"), certainty=Certainty.DEFINITE if sure else Certainty.HEDGED
        )
    return _unseen(query, view, f"No, I do not see {noun}.")


def _check(query: Query, view: View) -> Answer:
    """Look for the thing without what is asked of it, then see whether that holds."""
    target = query.target
    if target.anything or not target.named:
        return _exists(query, view)
    if target.state:
        return _check_state(query, view)
    if query.said:
        base = replace(target, colors=tuple(c for c in target.colors if c not in query.said))
        found = resolve(base, view)
        if not found:
            return UNKNOWN
        color = view.things[found[0].index].color
        sure = found[0].fit >= SURE and not any(frozenset((color, c)) in NEAR_COLORS for c in query.said)
        verdict = "Yes" if color in query.said else "No"
        return _verdict(verdict, f"the {target.words} {be(target)} {color}", sure or verdict == "Yes", view, found[0])
    if target.links:
        found = resolve(target, view)
        if found and found[0].fit > 0.6:
            return _verdict(
                "Yes", f"the {target.words} {be(target)} {link_words(target)}", found[0].fit >= SURE, view, found[0]
            )
        base = resolve(replace(target, links=target.links[:-1]), view)
        anchors = resolve(target.links[-1].anchor, view, 1)
        if not base or not anchors:
            return UNKNOWN
        place = place_of(view, base[0].index)
        words = place[0] if place else f"not {link_words(replace(target, links=target.links[-1:]))}"
        return _verdict(
            "No", f"the {target.words} {be(target)} {words}", base[0].fit >= SURE and bool(place), view, base[0]
        )
    return UNKNOWN


def _check_state(query: Query, view: View) -> Answer:
    target = query.target
    found = resolve(replace(target, state=""), view)
    state = state_of(view, found[0].index, target.state) if found else None
    if state is None:
        return UNKNOWN
    verdict = "Yes" if state.value == target.state else "No"
    sentence = f"the {target.words} {be(target)} {state.value}"
    return _verdict(verdict, sentence, state.sure and found[0].fit >= SURE, view, found[0])


def _verdict(verdict: str, sentence: str, sure: bool, view: View, match: Match) -> Answer:
    words = f"{verdict}, {sentence}." if sure else f"{verdict}, it looks like {sentence}."
    answer = _answer(words, True, view, match, verdict.lower())
    return answer if sure else replace(answer, certainty=Certainty.HEDGED)


def _state(query: Query, view: View) -> Answer:
    found = resolve(replace(query.target, state=""), view)
    if not found:
        return UNKNOWN
    asked = query.measure.split()[0] if query.measure else ""
    scales = [asked] if asked else ["open", "on"]
    state = next((s for scale in scales if (s := state_of(view, found[0].index, scale)) is not None), None)
    if state is None:
        return UNKNOWN
    name = said(query.target, view.things[found[0].index].name)
    sentence = f"The {name} {be(query.target)} {state.value}."
    return _answer(sentence, state.sure and found[0].fit >= SURE, view, found[0], state.value)


def _compare(query: Query, view: View) -> Answer:
    """Both things must be seen, and what their nearness is measured to."""
    options = [(option, resolve(replace(option, links=()), view)) for option in query.options]
    if len(options) < 2 or not all(found for _, found in options):
        return UNKNOWN
    measures = []
    for _, found in options:
        thing = view.things[found[0].index]
        if query.measure in ("nearest", "farthest") and query.reference is not None:
            anchors = [m for m in resolve(query.reference, view, 1) if m.index != found[0].index]
            if not anchors:
                return UNKNOWN
            distance = min(gap_m(thing, view.things[m.index]) for m in anchors)
            measures.append(distance if query.measure == "nearest" else -distance)
        else:
            measures.append(extent(query.measure, thing))
    best = min(range(len(measures)), key=lambda i: (measures[i], i))
    rest = min(value for i, value in enumerate(measures) if i != best)
    clearly = rest - measures[best] > CLEARLY_DIFFERENT * max(abs(rest), abs(measures[best]))
    phrase, found = options[best]
    sure = clearly and all(f[0].fit >= SURE and not view.things[f[0].index].cut for _, f in options)
    return _answer(f"The {phrase.words}.", sure, view, found[0], phrase.words)


def _which(query: Query, view: View) -> Answer:
    found = resolve(query.target, view)
    if not found:
        return UNKNOWN
    thing = view.things[found[0].index]
    place = place_of(view, found[0].index, without=frozenset({thing.name}))
    words = f"The {thing.color} {singular(query.target.words) or thing.name}{_and(place[0] if place else '')}."
    return _answer(words, found[0].fit >= SURE, view, found[0], words)


def _use(query: Query, view: View) -> Answer:
    names = useful_names(query.words)
    for rank, name in enumerate(names):
        phrase = replace(query.target, words=name, exact=frozenset({name}), kinds=frozenset(), colors=(), state="")
        found = [m for m in resolve(phrase, view) if m.fit > 0.5]
        if found:
            sentence = f"you can use the {name}."
            words = f"Yes, {sentence}" if query.measure else sentence[0].upper() + sentence[1:]
            answer = _answer(words, found[0].fit >= SURE, view, found[0], name)
            return replace(answer, support=answer.support / (1 + rank))
    return UNKNOWN


def _purpose(query: Query, view: View) -> Answer:
    for name in sorted(query.target.exact) + sorted(query.target.kinds):
        purpose = purpose_of(name)
        if purpose:
            found = resolve(query.target, view)
            text = f"The {query.target.words} {be(query.target)} used for {purpose}."
            return Answer(text, Certainty.DEFINITE, found[0].fit if found else 0.0, purpose)
    return UNKNOWN


def _room(query: Query, view: View) -> Answer:
    room = room_of(view)
    if not room:
        return UNKNOWN
    sure = len({thing.name for thing in view.things if thing.name in ROOM_SIGNS[room]}) >= SIGNS_NEEDED
    if query.target.anything or not query.target.words:
        text = hedged(f"This is the {room}.", sure)
        return Answer(text, Certainty.DEFINITE if sure else Certainty.HEDGED, 0.5, room)
    found = resolve(query.target, view)
    if not found:
        return UNKNOWN
    sentence = f"The {query.target.words} {be(query.target)} in the {room}."
    return _answer(sentence, sure and found[0].fit >= SURE, view, found[0], room)


def _material(query: Query, view: View) -> Answer:
    found = resolve(query.target, view)
    material = MATERIALS.get(view.things[found[0].index].name, "") if found else ""
    if not material:
        return UNKNOWN
    return _answer(f"The {query.target.words} {be(query.target)} made of {material}.", False, view, found[0], material)


def _side(query: Query, view: View) -> Answer:
    if not query.target.links:
        return UNKNOWN
    anchor = query.target.links[0].anchor
    found = resolve(replace(query.target, links=()), view)
    anchors = [m for m in resolve(anchor, view, 1) if not found or m.index != found[0].index]
    if not found or not anchors:
        return UNKNOWN
    first, second = found[0].index, anchors[0].index
    side = "left" if left(view, first, second) else "right" if left(view, second, first) else ""
    if not side:
        return UNKNOWN
    sentence = f"The {query.target.words} {be(query.target)} on the {side} of the {anchor.words}."
    return _answer(sentence, found[0].fit >= SURE, view, found[0], side)


def _describe(query: Query, view: View) -> Answer:
    found = resolve(query.target, view)
    if not found:
        return _unseen(query, view, f"I do not see {_described(query.target)}.")
    thing = view.things[found[0].index]
    place = place_of(view, found[0].index, without=frozenset({thing.name}))
    where = link_words(_seen_links(query.target, view)) or (place[0] if place else "in this view")
    sentence = f"The {thing.color} {said(query.target, thing.name)} is {where}."
    return _answer(sentence, found[0].fit >= SURE, view, found[0], sentence)


def _seen_links(target: Phrase, view: View) -> Phrase:
    """Return the phrase with those links whose anchors are in view: only these were checked."""

    def is_seen(link: Link) -> bool:
        return bool(resolve(link.anchor, view, 1))

    return replace(target, links=tuple(link for link in target.links if is_seen(link)))


def _cannot(query: Query, view: View) -> Answer:
    return UNKNOWN


def _described(target: Phrase) -> str:
    """Return "a blue chair next to the bed" for a phrase."""
    noun = " ".join((*target.colors[:1], target.words or "thing"))
    return f"{noun if target.plural else with_article(noun)}{_and(link_words(target))}"


def _and(text: str) -> str:
    return f" {text}" if text else ""


def _wanted_number(query: Query) -> int | None:
    """Return the least number asked for in "more than two" and "at least two"."""
    for index in range(len(query.words) - 2):
        n = number(query.words[index + 2])
        if n is not None and query.words[index : index + 2] in (("more", "than"), ("at", "least")):
            return n + 1 if query.words[index] == "more" else n
    return None


_ANSWERS: dict[Kind, Callable[[Query, View], Answer]] = {
    "count": _count,
    "color": _color,
    "where": _where,
    "identify": _identify,
    "exists": _exists,
    "check": _check,
    "state": _state,
    "compare": _compare,
    "which": _which,
    "use": _use,
    "purpose": _purpose,
    "room": _room,
    "material": _material,
    "side": _side,
    "describe": _describe,
    "unknown": _cannot,
}
