"""Spatial understanding: nearer, left or right, between, above or below, how many."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.grounding import counted_groups, group_where
from pipeline.scene.questions.names import names
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.recognition import name_objects
from pipeline.scene.questions.world import World

_CLOSER = (
    "which is closer to the {x}, the {a} or the {b}?",
    "which one is nearer to the {x}: the {a} or the {b}?",
    "is the {a} or the {b} closer to the {x}?",
)
_SIDE = (
    "is the {o} to the left or to the right of the {x}, when facing the {x}?",
    "when you face the {x}, is the {o} on its left or on its right?",
    "facing the {x}, on which side of it is the {o}, left or right?",
)
_WALKER = (
    "if I stand at the {p} and look at the {q}, is the {o} on my left or on my right?",
    "standing at the {p} and facing the {q}, on which side is the {o}, left or right?",
    "I am at the {p}, looking toward the {q}. is the {o} to my left or to my right?",
)
_COUNT = ("how many {g} are there {w}?", "how many {g} can you count {w}?", "what is the number of {g} {w}?")
_BETWEEN = (
    "what is between the {a} and the {b}?",
    "which object stands between the {a} and the {b}?",
    "what do you find between the {a} and the {b}?",
)
_ABOVE = ("is the {a} above or below the {b}?", "does the {a} hang above or below the {b}?")
_TOGETHER = (
    "is the {a} in the same room as the {b}?",
    "are the {a} and the {b} in the same room?",
    "do I find the {a} and the {b} in one room?",
)
_FACED = names(
    "desk, tv, stand, bookshelf, shelf, cabinet, dresser, wardrobe, bed, couch, sink, stove, refrigerator, toilet, "
    "mirror, counter, nightstand, machine, dishwasher, piano, fireplace, window, picture, poster, whiteboard, oven"
)
"""Categories, by their last word, that have a front."""
_FURNITURE_M = 0.7
"""Longest side from which a thing is a place to stand at or to face."""
_AT_WALL_M = 0.3
"""Distance up to which a thing stands at a wall."""
_TRIES = 6
"""Random partners tried for an object; all pairs and triples would be thousands."""


def spatial(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield spatial understanding questions."""
    named = [i for i in world.askable if describer.plain[i]]
    yield from _counts(world, describer, rng)
    for i in named:
        neighbours = [j for j in named if j != i and world.same_room(i, j) and _apart(world, i, j)]
        for _ in range(_TRIES if len(neighbours) >= 2 else 0):
            a, b = (neighbours[k] for k in rng.choice(len(neighbours), 2, replace=False))
            yield from _closer(world, describer, rng, i, a, b)
            yield from _walker(world, describer, rng, i, a, b)
            yield from _between(world, describer, rng, i, a, b)
        yield from _sides(world, describer, rng, i, neighbours)
        yield from _pairs(world, describer, rng, i, named)


def front_of(world: World, position: int) -> Float[np.ndarray, "2"] | None:
    """Return the horizontal unit vector out of the front of a thing that stands with its back to a wall.

    None where no wall, or more than one side's wall, makes the front a matter of opinion.
    """
    layout, backs = world.layout, []
    floor = world.floors.get(world.objects[position].room)
    if floor is None or not world.room_of[position]:
        return None
    angle = float(layout.yaw[position])
    for quarter in range(4):
        direction = np.array([np.cos(angle + quarter * np.pi / 2), np.sin(angle + quarter * np.pi / 2)])
        reached = layout.center[position, :2] + direction * (layout.half[position, quarter % 2] + _AT_WALL_M)
        if (reached < floor[0]).any() or (reached > floor[1]).any():
            backs.append(direction)
    return -backs[0] if len(backs) == 1 else None


def _apart(world: World, i: int, j: int) -> bool:
    """Return whether neither rests on or in the other."""
    tables = [world.relations.may_hold[name] for name in ("on", "in", "under")]
    return not any(table[i, j] or table[j, i] for table in tables)


def _text(describer: Describer, position: int) -> str:
    return describer.plain[position][0].text


def _counts(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    for group, positions in counted_groups(world, describer):
        noun, where = group.nouns, group_where(group, len(positions)) or "in total"
        if len(positions) == 1 and (group.place or group.color):
            continue
        kind = f"count {'several' if len(positions) > 1 else 'one'}"
        yield Draft(kind, worded(rng, _COUNT, g=noun, w=where), str(len(positions)), positions, group.category)


def _closer(world: World, describer: Describer, rng: np.random.Generator, x: int, a: int, b: int) -> Iterator[Draft]:
    if not _apart(world, a, b) or world.objects[a].category == world.objects[b].category == "window":
        return
    if world.nearer(x, b, a):
        near = b
    elif world.nearer(x, a, b):
        near = a
    else:
        return
    question = worded(rng, _CLOSER, x=_text(describer, x), a=_text(describer, a), b=_text(describer, b))
    yield Draft("closer", question, f"The {_text(describer, near)}", (near, x), world.objects[near].category)


def _walker(world: World, describer: Describer, rng: np.random.Generator, p: int, q: int, o: int) -> Iterator[Draft]:
    centers = world.layout.center[:, :2]
    length = float(np.linalg.norm(centers[q] - centers[p]))
    longest = world.layout.longest
    if length < 1.2 or longest[q] > 2.5 or longest[p] < _FURNITURE_M or longest[q] < 0.5:
        return
    ahead = (centers[q] - centers[p]) / length
    depth = float(ahead @ (centers[o] - centers[p]))
    right = float(np.array([ahead[1], -ahead[0]]) @ (centers[o] - centers[p]))
    width = float(world.layout.extent(np.array([ahead[1], -ahead[0]]))[o])
    if not 0.3 <= depth <= 1.3 * length or abs(right) - width < 0.3 or not 0.35 * depth <= abs(right) <= 2.5 * depth:
        return
    question = worded(rng, _WALKER, p=_text(describer, p), q=_text(describer, q), o=_text(describer, o))
    answer = "On the right" if right > 0 else "On the left"
    yield Draft("side seen by a walker", question, answer, (o, p, q), world.objects[o].category)


def _between(world: World, describer: Describer, rng: np.random.Generator, a: int, b: int, _: int) -> Iterator[Draft]:
    strict = np.flatnonzero(stand_between(world, a, b)).tolist()
    if len(strict) == 1 and strict == np.flatnonzero(stand_between(world, a, b, lenient=True)).tolist():
        question = worded(rng, _BETWEEN, a=_text(describer, a), b=_text(describer, b))
        category = world.objects[strict[0]].category
        yield Draft("between", question, name_objects(world, strict), (strict[0],), category)


def stand_between(world: World, a: int, b: int, *, lenient: bool = False) -> Bool[np.ndarray, "n"]:
    """Return which objects stand between two others on the floor plan, on their level and away from both ends."""
    layout, relations = world.layout, world.relations
    line = layout.center[b, :2] - layout.center[a, :2]
    length = float(np.linalg.norm(line))
    if length < 0.8 or not 0.4 <= layout.gap[a, b] <= 2.2 or not world.same_room(a, b):
        return np.zeros(len(world.objects), bool)
    offset = layout.center[:, :2] - layout.center[a, :2]
    along = offset @ line / length**2
    across = np.abs(line[0] * offset[:, 1] - line[1] * offset[:, 0]) / length
    margin, width = (0.1, 0.5) if lenient else (0.25, 0.3)
    fits = (along >= margin) & (along <= 1 - margin) & (across <= width * max(1.0, length / 2))
    for end in (a, b):
        fits &= (layout.vertical_gap[end] <= 0.2) & (relations.rests == relations.rests[end])
        fits &= np.abs(layout.bottom - layout.bottom[end]) <= 0.4
        for name in ("on", "in", "under"):
            fits &= ~(relations.may_hold[name][end] | relations.may_hold[name][:, end])
    fits[[a, b]] = False
    same_room = np.array([world.same_room(i, a, b) for i in range(len(world.objects))], bool)
    return fits & world.is_askable & same_room


def _sides(
    world: World, describer: Describer, rng: np.random.Generator, x: int, neighbours: list[int]
) -> Iterator[Draft]:
    front = front_of(world, x)
    if front is None or world.objects[x].category.rsplit(" ", 1)[-1] not in _FACED:
        return
    # Facing the front, the viewer looks along -front; their right hand points along (-front) turned clockwise.
    right = np.array([-front[1], front[0]])
    extent = world.layout.extent(right)
    for o in neighbours:
        offset = world.layout.center[o, :2] - world.layout.center[x, :2]
        side, depth = float(right @ offset), float(front @ offset)
        beside = abs(side) - extent[o] >= extent[x] and abs(side) >= 1.2 * abs(depth)
        if not beside or world.layout.gap[x, o] > 1.5:
            continue
        question = worded(rng, _SIDE, x=_text(describer, x), o=_text(describer, o))
        answer = "To the right" if side > 0 else "To the left"
        yield Draft("side of a thing one faces", question, answer, (o, x), world.objects[o].category)


def _pairs(world: World, describer: Describer, rng: np.random.Generator, i: int, named: list[int]) -> Iterator[Draft]:
    o = world.objects[i]
    for below in np.flatnonzero(world.relations.holds["above"][i]).tolist():
        if below not in named:
            continue
        pair = [i, below]
        first = int(rng.integers(2))
        a, b = _text(describer, pair[first]), _text(describer, pair[1 - first])
        if first:
            question, answer = worded(rng, _ABOVE[:1], a=a, b=b), "Below"
        else:
            question, answer = worded(rng, _ABOVE, a=a, b=b), "Above"
        yield Draft("above or below", question, answer, (i, below), o.category)
    others = [j for j in named if j != i and world.room_of[j] and not describer.plain[j][0].room]
    if len(world.rooms) < 2 or not others or not world.room_of[i] or describer.plain[i][0].room:
        return
    j = others[int(rng.integers(len(others)))]
    together = world.same_room(i, j)
    question = worded(rng, _TOGETHER, a=_text(describer, i), b=_text(describer, j))
    yield Draft(f"same room {together}", question, "Yes" if together else "No", (i, j), o.category)
