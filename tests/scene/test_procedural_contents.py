"""Furnished apartments: what stands where, before anything becomes a Gaussian."""

from __future__ import annotations

from collections import Counter, defaultdict
from functools import cache

import numpy as np
import pytest

from pipeline.scene.color_names import COLOR_NAMES
from pipeline.scene.objects import SceneObject
from pipeline.scene.procedural.build import furnish
from pipeline.scene.procedural.furniture import BUILDERS
from pipeline.scene.procedural.home import Home
from pipeline.scene.procedural.things import oriented_boxes_overlap
from pipeline.scene.procedural.vocabulary import CATEGORY_IDS, VOCABULARY

STRUCTURE = ("floor", "wall", "ceiling")
OVERLAP_M = 0.003
"""Boxes may touch; the walls' own thickness apart, they never share more than this."""
CASES = [
    (0, 4),
    (3, 1),
    (4, 2),
    (5, 8),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in ((1, 4), (2, 4), (6, 12))),
]
"""Seed and rooms."""


@cache
def home(seed: int, rooms: int) -> Home:
    return furnish(rooms, np.random.default_rng([seed, 0]))


def described(built: Home) -> list[SceneObject]:
    return [thing.describe(built.layout.rooms[thing.room].name) for thing in built.things]


@pytest.mark.parametrize(("seed", "rooms"), CASES)
def test_things_do_not_intersect_unless_one_holds_the_other(seed: int, rooms: int) -> None:
    built = home(seed, rooms)
    things = [thing for thing in built.things if thing.model.category not in STRUCTURE]
    boxes = np.stack([thing.box for thing in things])
    clashes = []
    for i, a in enumerate(things):
        near = (boxes[i, 0] < boxes[:, 1]).all(axis=1) & (boxes[:, 0] < boxes[i, 1]).all(axis=1)
        for j in np.flatnonzero(near):
            b = things[j]
            held = a.parent == b.instance or b.parent == a.instance
            held = held or built.things[a.parent].parent == b.instance or built.things[b.parent].parent == a.instance
            if i < j and not held and oriented_boxes_overlap(a, b, -OVERLAP_M):
                clashes.append((a.model.category, b.model.category))
    assert not clashes


@pytest.mark.parametrize(("seed", "rooms"), CASES)
def test_things_lie_inside_their_room(seed: int, rooms: int) -> None:
    built = home(seed, rooms)
    for thing in built.things:
        if thing.model.category in STRUCTURE or ("closed" in thing.model.states and thing.model.category == "door"):
            continue
        room = built.layout.rooms[thing.room]
        assert all(room.contains(float(x), float(y), -0.002) for x, y in thing.footprint), thing.model.category
        assert thing.box[0, 2] > -0.016, thing.model.category
        assert thing.box[1, 2] < room.height + 0.001, thing.model.category


@pytest.mark.parametrize(("seed", "rooms"), CASES)
def test_nothing_floats(seed: int, rooms: int) -> None:
    built = home(seed, rooms)
    for thing in built.things:
        if thing.model.category in STRUCTURE:
            continue
        bottom = thing.box[0, 2]
        if thing.mount == "back":
            wall = built.things[thing.host]
            gap = np.abs(thing.footprint[:, None] - wall.box[:, :2]).min()
            assert wall.model.category == "wall"
            assert gap < 0.08
        elif thing.mount == "top":
            assert built.things[thing.host].model.category == "ceiling"
        elif built.things[thing.host].model.category == "floor":
            # Radiators hang a hand's breadth above the floor on their own brackets.
            assert bottom < (0.13 if thing.model.category == "radiator" else 0.012), thing.model.category
        else:
            supports = [slot.low[2] for slot in built.things[thing.host].model.slots]
            height = bottom - built.things[thing.host].at[2]
            assert min(abs(height - z) for z in supports) < 0.012, thing.model.category


@pytest.mark.parametrize(("seed", "rooms"), CASES)
def test_relations_hold_in_the_geometry(seed: int, rooms: int) -> None:
    built = home(seed, rooms)
    for thing in built.things:
        if thing.parent < 0 or built.things[thing.parent].model.category in STRUCTURE:
            continue
        parent = built.things[thing.parent]
        middle = thing.box.mean(axis=0)
        c, s = np.cos(parent.yaw), np.sin(parent.yaw)
        dx, dy = middle[:2] - parent.at[:2]
        local = np.array([c * dx + s * dy, -s * dx + c * dy, middle[2] - parent.at[2]])
        low, high = parent.model.bounds
        above = (local[:2] > low[:2]).all() and (local[:2] < high[:2]).all()
        if thing.relation in ("on", "in"):
            assert above
            assert low[2] < thing.box[0, 2] - parent.at[2] + 1e-6
            assert thing.relation == "on" or thing.box[0, 2] < parent.box[1, 2]
        elif thing.relation == "under":
            assert above
            assert thing.box[1, 2] < parent.box[1, 2]
        else:
            assert thing.relation == "behind"
            assert not above
            assert parent.model.category in ("couch", "armchair", "door")


@pytest.mark.parametrize(("seed", "rooms"), CASES[:3])
def test_an_apartment_is_rich(seed: int, rooms: int) -> None:
    objects = described(home(seed, rooms))
    colors = defaultdict(set)
    for thing in objects:
        colors[thing.category].add(thing.color)
    assert len(colors) >= 25 + len(STRUCTURE)
    assert len([1 for names in colors.values() if len(names) >= 2]) >= 10
    assert {thing.relation for thing in objects} == {"", "on", "in", "under", "behind"}
    assert {state for thing in objects for state in thing.states} == {"open", "closed", "on", "off"}
    assert len({thing.room for thing in objects}) == rooms
    assert Counter(thing.category for thing in objects)["floor"] == rooms


def test_every_builder_gives_a_known_category_and_color() -> None:
    assert len({build(np.random.default_rng(0)).category for build in BUILDERS.values()}) >= 100
    for name, build in BUILDERS.items():
        for seed in range(4):
            model = build(np.random.default_rng(seed))
            assert model.category in CATEGORY_IDS, name
            assert model.color in (*COLOR_NAMES, ""), name
            assert (model.size > 0.005).all(), name


def test_vocabulary_is_sorted_distinct_and_larger_than_any_scene() -> None:
    assert list(VOCABULARY) == sorted(set(VOCABULARY))
    assert len(VOCABULARY) >= 200


def test_same_seed_gives_the_same_contents_and_another_seed_does_not() -> None:
    first, again, other = (described(furnish(2, np.random.default_rng(seed))) for seed in (7, 7, 8))
    assert first == again
    assert first != other
