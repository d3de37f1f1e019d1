"""Attribute recognition: colours and sizes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.scene.color_names import COLOR_NAMES
from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.grounding import group_text, groups
from pipeline.scene.questions.names import capital
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.world import UNCOLORED, World

_COLOR = ("what color {be} the {o}?", "what is the color of the {o}?", "which color {do} the {o} have?")
_CHOICE = ("{be} the {o} {a} or {b}?", "would you say the {o} {be} {a} or {b}?", "what color {be} the {o}, {a} or {b}?")
_TALLER = ("which is taller, the {a} or the {b}?", "which one is taller: the {a} or the {b}?")
_LARGER = ("which is bigger, the {a} or the {b}?", "which of the two is larger, the {a} or the {b}?")
_CLEAR_RATIO = 1.6
"""Ratio of sizes from which everyone agrees which is larger."""
_COMPARABLE = 12.0
"""Ratio beyond which nobody would ask."""


def attributes(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield attribute recognition questions."""
    colors = sorted({world.color_of(i) for i in world.askable} - {""})
    for i in world.askable:
        color = world.color_of(i)
        phrase = describer.pick(i, rng, colored=False)
        if not color or phrase is None:
            continue
        o = world.objects[i]
        do = "do" if phrase.be == "are" else "does"
        question = worded(rng, _COLOR, o=phrase.text, be=phrase.be, do=do)
        yield Draft("color", question, capital(color), (i,), o.category)
        others = [c for c in (colors if len(colors) > 3 else COLOR_NAMES) if not world.colors_alike(c, color)]
        pair = [color, others[int(rng.integers(len(others)))]]
        first = int(rng.integers(2))
        question = worded(rng, _CHOICE, o=phrase.text, be=phrase.be, a=pair[first], b=pair[1 - first])
        yield Draft("color choice", question, capital(color), (i,), o.category)
    for group, positions in groups(world, describer):
        shared = {world.color_of(i) for i in positions}
        if len(shared) == 1 and "" not in shared and not group.color:
            color = shared.pop()
            question = worded(rng, _COLOR, o=group_text(group, len(positions)), be="are", do="do")
            yield Draft("color of several", question, capital(color), positions, group.category)
    yield from _sizes(world, describer, rng)


def _sizes(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    height = {i: world.stature(i) for i in world.askable}
    volume = dict(enumerate(world.layout.volume.tolist()))
    longest = dict(enumerate(world.layout.longest.tolist()))
    kinds = (("taller", _TALLER, height, height), ("larger", _LARGER, volume, longest))
    level = _levels(world)
    for i in world.askable:
        partners = [
            j
            for j in world.askable
            if j != i and world.same_room(i, j) and describer.plain[j] and level[i] == level[j] != "hanging"
        ]
        if not describer.plain[i] or not partners:
            continue
        j = partners[int(rng.integers(len(partners)))]
        a, b = describer.plain[i][0].text, describer.plain[j][0].text
        for kind, templates, size, also in kinds:
            big, small = (i, j) if size[i] > size[j] else (j, i)
            ratio = size[big] / max(1e-6, size[small])
            if _CLEAR_RATIO <= ratio <= _COMPARABLE and also[big] > also[small]:
                answer = f"The {describer.plain[big][0].text}"
                yield Draft(kind, worded(rng, templates, a=a, b=b), answer, (big, small), world.objects[big].category)


def _levels(world: World) -> list[str]:
    """Return how each object stands: what hangs on walls or is let into a thing has no height of its own."""
    floor = min((world.layout.bottom[i] for i in world.askable), default=0.0)
    levels = []
    for i, o in enumerate(world.objects):
        on_something = bool(world.relations.holds["on"][i].any())
        inside = bool(world.relations.holds["in"][i].any())
        flat = world.layout.half[i, 2] < 0.04
        if o.category in UNCOLORED or inside or flat or not (on_something or world.layout.bottom[i] <= floor + 0.25):
            levels.append("hanging")
        else:
            levels.append("up" if on_something else "floor")
    return levels
