"""Answers about places and purposes: where a thing is, what room this is, what can be used for something."""

from __future__ import annotations

from dataclasses import replace

from pipeline.models.symbolic.answer import UNKNOWN, Answer
from pipeline.models.symbolic.answering import elsewhere, stated, verdict
from pipeline.models.symbolic.certainty import Certainty
from pipeline.models.symbolic.knowledge import ROOM_SIGNS, STRUCTURE
from pipeline.models.symbolic.lexicon import canonical
from pipeline.models.symbolic.phrases import Phrase, Query
from pipeline.models.symbolic.resolve import SURE, Match, resolve, room_of, room_signs
from pipeline.models.symbolic.sentences import be, hedged, place_of, spaced
from pipeline.models.symbolic.uses import purpose_of, useful_names
from pipeline.models.symbolic.view import View

SIGNS_NEEDED = 2
"""Kinds of things that must point to a room to be sure of it."""
FITS = 0.5


def where(query: Query, view: View) -> Answer:
    """Say what holds a thing or stands next to it, and in which room where that is plain."""
    found = resolve(query.target, view)
    if not found:
        return UNKNOWN
    name = query.target.words or view.things[found[0].index].name
    place = place_of(view, found[0].index, without=query.target.exact | query.target.kinds)
    room = _sure_room(view, found[0])
    if place is None:
        if not room:
            return UNKNOWN
        return stated(f"The {name} {be(query.target)} in the {room}.", found[0].fit >= SURE, view, found[0], room)
    words, sure = place
    sentence = f"The {name} {be(query.target)} {words}{spaced(f'in the {room}' if room else '')}."
    return stated(sentence, sure and found[0].fit >= SURE, view, found[0], words)


def room(query: Query, view: View) -> Answer:
    """Name the room of the view, of the thing asked about, or the one that serves a purpose."""
    if query.measure == "use":
        known = next(
            (room for name in useful_names(query.words) for room in ROOM_SIGNS if name in ROOM_SIGNS[room]), ""
        )
        return Answer(f"The {known}.", Certainty.DEFINITE, 0.5, known) if known else UNKNOWN
    if query.target.anything:
        seen = room_of(view)
        if not seen:
            return UNKNOWN
        sure = room_signs(view, seen) >= SIGNS_NEEDED
        level = Certainty.DEFINITE if sure else Certainty.HEDGED
        return Answer(hedged(f"This is the {seen}.", sure), level, 0.5, seen, room=seen)
    found = resolve(query.target, view)
    seen = room_of(view, found[0].index) if found else ""
    if not seen:
        return UNKNOWN
    sure = found[0].fit >= SURE and room_signs(view, seen) >= SIGNS_NEEDED
    return stated(f"The {query.target.words} {be(query.target)} in the {seen}.", sure, view, found[0], seen)


def same_room(query: Query, view: View) -> Answer:
    """Things seen together are taken to be in one room unless signs of two rooms stand about them."""
    found = [resolve(phrase, view) for phrase in (query.target, *query.options[:1])]
    if len(found) < 2 or not all(found):
        return UNKNOWN
    first, second = found[0][0], found[1][0]
    rooms = {room_of(view, first.index), room_of(view, second.index)} - {""}
    sure = first.fit >= SURE and second.fit >= SURE
    if len(rooms) > 1:
        return verdict("No", "they are in different rooms", False, view, first)
    return verdict("Yes", "they are in the same room", sure, view, first)


def use(query: Query, view: View) -> Answer:
    """Name the most useful thing in view, and for "where" its room."""
    # What is to be done may name things too ("wash my hands in warm water"); only places in the scene narrow it down.
    links = tuple(link for link in query.target.links if link.anchor.named)
    for rank, name in enumerate(useful_names(query.words)):
        seen_names = frozenset(thing.name for thing in view.things if thing.kind == canonical(name))
        phrase = Phrase(name, seen_names, room=query.target.room, links=links)
        found = [m for m in resolve(phrase, view) if m.fit > FITS]
        if not found or name in STRUCTURE:
            continue
        sure = found[0].fit >= SURE
        if query.measure == "can":
            answer = verdict("Yes", f"you can use the {name}", sure, view, found[0])
        else:
            seen = _sure_room(view, found[0]) if query.measure == "where" else ""
            answer = stated(
                f"You can use the {name}{spaced(f'in the {seen}' if seen else '')}.", sure, view, found[0], name
            )
        return replace(answer, support=answer.support / (1 + rank))
    return elsewhere(query, view, "No, I do not see anything for that.") if query.measure == "can" else UNKNOWN


def purpose(query: Query, view: View) -> Answer:
    """Say what a thing is used for: knowledge that needs no look, but a view that shows it supports it."""
    for name in sorted(query.target.exact) + sorted(query.target.kinds):
        known = purpose_of(name)
        if known:
            found = resolve(query.target, view)
            text = f"The {query.target.words} {be(query.target)} used for {known}."
            return Answer(text, Certainty.DEFINITE, found[0].fit if found else 0.0, known)
    return UNKNOWN


def _sure_room(view: View, match: Match) -> str:
    seen = room_of(view, match.index)
    return seen if room_signs(view, seen) >= SIGNS_NEEDED else ""
