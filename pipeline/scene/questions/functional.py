"""Functional reasoning and world knowledge: what things are for, asked plainly or through a situation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.scene.questions.affordances import ROOM_PURPOSES, USES, Use, present
from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.localization import describe_places
from pipeline.scene.questions.names import capital, is_plural, join_names, with_article
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.world import World

_WHERE = ("where can I {do}?", "where could I {do}?", "where would I go to {do}?")
_WHAT = ("what can I {do} {room}?", "what is there to {do} {room}?", "what could I {do} {room}?")
_IS_THERE = (
    "is there something to {do} in the {room}?",
    "can I find something to {do} in the {room}?",
    "does the {room} have anything to {do}?",
)
_WHICH = (
    "which object would I use to {do}?",
    "what would I need in order to {do}?",
    "what should I look for if I want to {do}?",
)
_CAN_ONE = ("can I {do} in the {room}?", "is it possible for me to {do} in the {room}?", "could I {do} in the {room}?")
_MOST = 3
"""Answers name at most so many things."""


def functional(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield functional reasoning questions: where and with what something can be done."""
    for use in USES:
        yield from _where(world, rng, use)
        for room in world.rooms:
            objects = _serving(world, use, room)
            kinds = present(use, [world.objects[i].category for i in objects])
            if use.things and 1 <= len(kinds) <= 2:
                question = worded(rng, _WHAT, do=use.things, room=f"in the {room}")
                yield _naming(world, "what for", question, objects, kinds, _also(world, use, room))
            if use.fixed and world.relations.complete and bool(objects) == bool(objects + _also(world, use, room)):
                question = worded(rng, _CAN_ONE, do=use.action, room=room)
                about = world.objects[objects[0]].category if objects else min(use.serves)
                yield Draft(
                    f"can one {bool(objects)}", question, "Yes" if objects else "No", tuple(objects[:_MOST]), about
                )


def knowledge(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield world knowledge questions: situations, purposes of rooms, which object serves."""
    for use in USES:
        objects = _serving(world, use, "")
        kinds = present(use, [world.objects[i].category for i in objects])
        if 1 <= len(kinds) <= 2:
            also = _also(world, use, "")
            if use.action:
                yield _naming(world, "which object", worded(rng, _WHICH, do=use.action), objects, kinds, also)
            yield _naming(world, "situation", worded(rng, use.needs), objects, kinds, also)
        for room in world.rooms if use.something else ():
            yield from _something(world, describer, rng, use, room)
    if len(world.rooms) > 1:
        for _, makers, question in ROOM_PURPOSES:
            makes = [i for i in world.askable if world.objects[i].category in makers]
            rooms = sorted({world.room_of[i] for i in makes})
            if len(rooms) == 1 and rooms[0]:
                about = world.objects[makes[0]].category
                yield Draft("room purpose", capital(question), f"The {rooms[0]}", tuple(makes[:_MOST]), about)


def _serving(world: World, use: Use, room: str) -> list[int]:
    return [
        i for i in world.askable if world.objects[i].category in use.serves and (not room or world.room_of[i] == room)
    ]


def _also(world: World, use: Use, room: str) -> list[int]:
    return [
        i for i in world.askable if world.objects[i].category in use.also and (not room or world.room_of[i] == room)
    ]


def _where(world: World, rng: np.random.Generator, use: Use) -> Iterator[Draft]:
    objects = _serving(world, use, "")
    if not use.at or not 1 <= len(objects) <= _MOST:
        return
    answers = []
    for i in objects:
        room = world.room_of[i]
        noun = world.objects[i].category
        answers.append(f"{use.at} the {noun}" + (f" in the {room}" if room else ""))
    answers = list(dict.fromkeys(capital(text) for text in answers))
    extra = [capital(f"{use.at} the {world.objects[i].category}") for i in objects]
    extra += [capital(f"in the {world.room_of[i]}") for i in objects if world.room_of[i]]
    extra += [f"The {world.objects[i].category}" for i in _also(world, use, "")]
    others = tuple(t for t in dict.fromkeys(answers[1:] + extra) if t != answers[0])
    question = worded(rng, _WHERE, do=use.action)
    yield Draft("where can I", question, answers[0], tuple(objects), world.objects[objects[0]].category, others)


def _naming(
    world: World, kind: str, question: str, objects: list[int], kinds: tuple[str, ...], also: list[int]
) -> Draft:
    named = [with_article(k) if is_plural(k) else f"the {k}" for k in kinds]
    extra = [capital(text) for text in named] if len(named) > 1 else []
    extra += [f"The {world.objects[i].category}" for i in also]
    answer = capital(join_names(named, "or"))
    return Draft(kind, question, answer, tuple(objects), kinds[0], tuple(dict.fromkeys(extra)))


def _something(world: World, describer: Describer, rng: np.random.Generator, use: Use, room: str) -> Iterator[Draft]:
    objects, also = _serving(world, use, room), _also(world, use, room)
    question = worded(rng, _IS_THERE, do=use.something, room=room)
    if objects:
        category = world.objects[objects[0]].category
        places = describe_places(world, describer, objects[0])
        spot = next((p for p in places if " in the " + room not in p and not p.startswith("In the")), "")
        answer = f"Yes, the {category}" + (f" {spot[0].lower()}{spot[1:]}" if spot else "")
        extra = ("Yes", f"Yes, the {category}") if spot else ("Yes",)
        yield Draft("something to True", question, answer, tuple(objects), category, extra)
    elif not also and world.relations.complete:
        yield Draft("something to False", question, "No", (), min(use.serves))
