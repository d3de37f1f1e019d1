"""Object localization: where something is, with the answers a person may give."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.names import FIXTURES, capital
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.relations import RelationName
from pipeline.scene.questions.world import Phrase, World

_ANY = ("where {be} the {o}?", "where can I find the {o}?", "do you know where the {o} {be}?")
_PORTABLE = (
    *_ANY,
    "where did I leave the {o}?",
    "have you seen the {o}?",
    "I am looking for the {o}. where {be} {it}?",
)
_PORTABLE_M = 0.8
"""Longest side of what one may have left somewhere."""
_MOST_EXTRA = 4


def localization(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield object localization questions about objects that category, or colour and category, single out."""
    floor = min((float(world.layout.bottom[i]) for i in world.askable), default=0.0)
    for i in world.askable:
        options = [p for p in describer.plain[i] if not p.room]
        places = describe_places(world, describer, i)
        if not options or not places:
            continue
        phrase = options[int(rng.integers(len(options)))]
        o = world.objects[i]
        hung = world.layout.bottom[i] > floor + 0.3 and not world.relations.rests[i]
        portable = not hung and world.layout.longest[i] <= _PORTABLE_M and o.category.rsplit(" ", 1)[-1] not in FIXTURES
        it = "they" if phrase.be == "are" else "it"
        question = worded(rng, _PORTABLE if portable else _ANY, o=phrase.text, be=phrase.be, it=it)
        extra = tuple(places[1 : 1 + _MOST_EXTRA])
        yield Draft("where portable" if portable else "where furniture", question, places[0], (i,), o.category, extra)


def describe_places(world: World, describer: Describer, position: int) -> list[str]:
    """Return true answers to where an object is, the fullest first; empty where nothing places it."""
    room = world.room_of[position]
    in_room = f" in the {room}" if room else ""
    texts: list[str] = []
    resting = list(_placed(world, describer, position, ("on", "in", "under", "behind")))
    beside = list(_placed(world, describer, position, ("next to",)))
    for text in resting:
        texts += [text + in_room, text]
    for text in beside:
        texts += [text + in_room, text]
    if room and not resting:
        texts.append(f"in the {room}")
    return list(dict.fromkeys(capital(text) for text in texts))


def _placed(world: World, describer: Describer, position: int, names: tuple[RelationName, ...]) -> Iterator[str]:
    for name in names:
        anchors = np.flatnonzero(world.relations.holds[name][position]).tolist()
        for anchor in anchors:
            if anchor not in describer.plain or (name == "next to" and not describer.may_anchor(position, anchor)):
                continue
            yield f"{name} the {_anchor_noun(world, describer, anchor)}"


def _anchor_noun(world: World, describer: Describer, anchor: int) -> str:
    """Return the anchor's clear name without its room, or its category with its colour, else its category."""
    clear = [p for p in describer.plain[anchor] if not p.room]
    o = world.objects[anchor]
    return clear[0].noun if clear else Phrase(o.category, world.color_of(anchor)).noun
