"""Object recognition: what is on, in, under, behind, above or next to something."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.names import capital, count_word, is_plural, join_names, plural, with_article
from pipeline.scene.questions.phrases import PLACES, Describer
from pipeline.scene.questions.world import Phrase, World, relation_targets

_WORDS = {
    "on": ("what is on the {a}?", "what is lying or standing on the {a}?", "what object is on top of the {a}?"),
    "in": ("what is inside the {a}?", "what is in the {a}?", "what is kept in the {a}?"),
    "under": ("what is under the {a}?", "what is underneath the {a}?", "which object is under the {a}?"),
    "behind": ("what is behind the {a}?", "what stands behind the {a}?", "which object is hidden behind the {a}?"),
    "above": ("what is above the {a}?", "what hangs above the {a}?", "which object is right above the {a}?"),
    "next to": ("what is next to the {a}?", "what stands beside the {a}?", "which object is right next to the {a}?"),
}
_COLORED = {
    "on": ("what is the {c} object on the {a}?", "what is the {c} thing on the {a}?", "what {c} thing is on the {a}?"),
    "in": (
        "what is the {c} object inside the {a}?",
        "what is the {c} thing in the {a}?",
        "what {c} thing is in the {a}?",
    ),
    "under": (
        "what is the {c} object under the {a}?",
        "what is the {c} thing under the {a}?",
        "what {c} thing is underneath the {a}?",
    ),
    "behind": (
        "what is the {c} object behind the {a}?",
        "what is the {c} thing behind the {a}?",
        "what {c} thing is behind the {a}?",
    ),
    "next to": (
        "what is the {c} object next to the {a}?",
        "what is the {c} thing beside the {a}?",
        "what {c} thing is next to the {a}?",
    ),
}
_MOST_NAMED = 2
"""Answers name at most so many objects."""


def recognition(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield object recognition questions; answers name what is there, all of it."""
    for anchor in world.askable:
        phrase = describer.pick(anchor, rng)
        if phrase is None:
            continue
        for place in PLACES:
            strict, lenient = relation_targets(world, place, anchor)
            if not strict or not set(strict) <= set(world.askable):
                continue
            # The anchor's description must not give the answer away.
            if phrase.anchor in strict:
                phrase = describer.shortest(anchor)
                if phrase is None:
                    break
            if set(strict) == set(lenient) and len(strict) <= _MOST_NAMED:
                question = worded(rng, _WORDS[place], a=phrase.text)
                yield Draft(
                    f"what {place}", question, name_objects(world, strict), tuple(strict), _category(world, strict)
                )
            if len(lenient) > 1 and place in _COLORED:
                yield from _by_color(world, rng, place, phrase, strict, lenient)


def name_objects(world: World, positions: list[int]) -> str:
    """Return objects named by category: "A lamp and two pillows"."""
    categories = [world.objects[i].category for i in positions]
    named = []
    for category in dict.fromkeys(categories):
        count = categories.count(category)
        single = count == 1 or is_plural(category)
        named.append(with_article(category) if single else f"{count_word(count)} {plural(category)}")
    return capital(join_names(named))


def _by_color(
    world: World, rng: np.random.Generator, place: str, phrase: Phrase, strict: list[int], lenient: list[int]
) -> Iterator[Draft]:
    for i in strict:
        color = world.color_of(i)
        alike = [j for j in lenient if world.colors_alike(world.color_of(j), color)]
        if color and alike == [i] and world.objects[i].category != phrase.category:
            question = worded(rng, _COLORED[place], a=phrase.text, c=color)
            yield Draft(f"what colored thing {place}", question, name_objects(world, [i]), (i,), _category(world, [i]))


def _category(world: World, positions: list[int]) -> str:
    return world.objects[positions[0]].category
