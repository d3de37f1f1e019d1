"""Referring questions: which of several like things is meant, asked as a question."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.names import may_be_called, plural
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.spatial import stands_between
from pipeline.scene.questions.world import Phrase, World

_WHERE = (
    "which {noun} {be} {where}?",
    "which of the {nouns} {be} {where}?",
    "can you point out the {noun} that {be} {where}?",
)
_COLORED = (
    "which {category} {be} {color}?",
    "which one of the {categories} {be} {color}?",
    "can you show me the {color} {category}?",
)
_SUPERLATIVE = (
    "which {category} is the {word}{room}?",
    "which of the {categories}{room} is the {word}?",
    "what is the {word} {category}{room}?",
)
_BETWEEN = (
    "which {category} stands between the {a} and the {b}?",
    "which of the {categories} is between the {a} and the {b}?",
)
_CLEAR_RATIO = 1.25
"""Ratio of heights by which a superlative must lead..."""
_CLEAR_VOLUME_RATIO = 1.7
"""... and of volumes."""


def referring(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield questions that single out one object among others of its category."""
    for i in world.askable:
        o = world.objects[i]
        if sum(other.category == o.category for other in world.objects) < 2:
            continue
        for phrase in describer.all(i):
            kind = phrase.place or ("room" if phrase.room else "color")
            if _redundant(world, phrase, i):
                continue
            if phrase.where:
                question = worded(rng, _WHERE, noun=phrase.noun, nouns=phrase.nouns, be=phrase.be, where=phrase.where)
            else:
                category, categories = phrase.category, plural(phrase.category)
                question = worded(
                    rng, _COLORED, category=category, categories=categories, color=phrase.color, be=phrase.be
                )
            yield Draft(kind, question, None, (i,), o.category)
    yield from _superlatives(world, rng)
    yield from _between(world, describer, rng)


def _redundant(world: World, phrase: Phrase, position: int) -> bool:
    """Return whether the description would do without its colour, its place or its room."""
    shorter = [replace(phrase, color="")] if phrase.color else []
    if phrase.place:
        shorter.append(Phrase(phrase.category, phrase.color, phrase.room))
    if phrase.room:
        shorter.append(replace(phrase, room=""))
    return any(world.denotes_only(p, position) for p in shorter)


def _superlatives(world: World, rng: np.random.Generator) -> Iterator[Draft]:
    height, volume = 2 * world.layout.half[:, 2], world.layout.volume
    sizes = (("tallest", height), ("largest", volume), ("shortest", -height), ("smallest", -volume))
    for category in sorted({world.objects[i].category for i in world.askable}):
        for room in ("", *world.rooms):
            like = [
                i
                for i, o in enumerate(world.objects)
                if may_be_called(o.category, category) and (not room or world.room_of[i] == room)
            ]
            if sum(world.objects[i].category == category for i in like) < 2:
                continue
            for word, size in sizes:
                order = sorted(like, key=lambda i, size=size: -size[i])  # type: ignore[misc]
                first, second = abs(size[order[0]]), abs(size[order[1]])
                if world.objects[order[0]].category != category:
                    continue
                ratio = _CLEAR_RATIO if size is height or word == "shortest" else _CLEAR_VOLUME_RATIO
                if max(first, second) < ratio * max(1e-6, min(first, second)):
                    continue
                place = f" in the {room}" if room else ""
                question = worded(
                    rng, _SUPERLATIVE, category=category, categories=plural(category), word=word, room=place
                )
                yield Draft(f"superlative {word}", question, None, (order[0],), category)


def _between(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    named = [i for i in world.askable if describer.plain[i]]
    for i in world.askable:
        category = world.objects[i].category
        rivals = [j for j, o in enumerate(world.objects) if may_be_called(o.category, category)]
        if sum(world.objects[j].category == category for j in rivals) < 2:
            continue
        around = [j for j in named if j not in rivals and world.same_room(i, j) and world.layout.gap[i, j] < 2.0]
        for a in around:
            for b in (b for b in around if b > a):
                fits = [j for j in rivals if stands_between(world, j, a, b, lenient=True)]
                if fits == [i] and stands_between(world, i, a, b):
                    texts = {"a": describer.plain[a][0].text, "b": describer.plain[b][0].text}
                    question = worded(rng, _BETWEEN, category=category, categories=plural(category), **texts)
                    yield Draft("between", question, None, (i,), category)
