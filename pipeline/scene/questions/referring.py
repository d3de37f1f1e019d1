"""Referring questions: which of several like things is meant, asked as a question."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.names import may_be_called, names, plural
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.spatial import stand_between
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
_SHAPELESS = names("sink, door, mat, towel, switch, outlet, paper, blanket, clothes, window, light, mirror")
"""Categories, by their last word, nobody ranks by size."""
_CLEAR_RATIO = 1.25
"""Ratio of heights by which a superlative must lead..."""
_CLEAR_VOLUME_RATIO = 1.7
"""... and of volumes..."""
_CLEAR_LENGTH_RATIO = 1.15
"""... which must show in the longest sides, too."""


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


def _shapeless(category: str) -> bool:
    return category.rsplit(" ", 1)[-1] in _SHAPELESS


def _redundant(world: World, phrase: Phrase, position: int) -> bool:
    """Return whether the description would do without its colour, its place or its room."""
    shorter = [replace(phrase, color="")] if phrase.color else []
    if phrase.place:
        shorter.append(Phrase(phrase.category, phrase.color, phrase.room))
    if phrase.room:
        shorter.append(replace(phrase, room=""))
    return any(world.denotes_only(p, position) for p in shorter)


def _superlatives(world: World, rng: np.random.Generator) -> Iterator[Draft]:
    height = [world.stature(i) if i in world.askable else 0.0 for i in range(len(world.objects))]
    volume, longest = world.layout.volume.tolist(), world.layout.longest.tolist()
    words = (("tallest", 1, height), ("largest", 1, volume), ("shortest", -1, height), ("smallest", -1, volume))
    for category in sorted({world.objects[i].category for i in world.askable}):
        for room in ("", *world.rooms):
            like = [
                i
                for i, o in enumerate(world.objects)
                if may_be_called(o.category, category) and (not room or world.room_of[i] == room)
            ]
            if sum(world.objects[i].category == category for i in like) < 2 or _shapeless(category):
                continue
            for word, sign, size in words:
                order = sorted(like, key=lambda i, size=size, sign=sign: -sign * size[i])  # type: ignore[misc]
                first, second = order[:2]
                ratio = (size[first] / max(1e-6, size[second])) ** sign
                length_ratio = (longest[first] / max(1e-6, longest[second])) ** sign
                plain = ratio >= (_CLEAR_RATIO if size is height else _CLEAR_VOLUME_RATIO)
                plain &= size is height or length_ratio >= _CLEAR_LENGTH_RATIO
                if world.objects[first].category != category or not plain:
                    continue
                place = f" in the {room}" if room else ""
                question = worded(
                    rng, _SUPERLATIVE, category=category, categories=plural(category), word=word, room=place
                )
                yield Draft(f"superlative {word}", question, None, (first,), category)


def _between(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    named = [i for i in world.askable if describer.plain[i]]
    categories = [o.category for o in world.objects]
    for a in named:
        for b in (b for b in named if b > a and world.layout.gap[a, b] <= 2.2):
            strict, lenient = stand_between(world, a, b), stand_between(world, a, b, lenient=True)
            for i in np.flatnonzero(strict).tolist():
                category = categories[i]
                rivals = np.array([may_be_called(other, category) for other in categories], bool)
                if categories.count(category) < 2 or rivals[[a, b]].any() or (rivals & lenient).sum() != 1:
                    continue
                texts = {"a": describer.plain[a][0].text, "b": describer.plain[b][0].text}
                question = worded(rng, _BETWEEN, category=category, categories=plural(category), **texts)
                yield Draft("between", question, None, (i,), category)
