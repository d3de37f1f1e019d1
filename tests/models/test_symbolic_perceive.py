"""What the symbolic observer makes out in a view: parts, things, sizes, colours, doubts."""

from __future__ import annotations

import dataclasses
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.models.symbolic.components import BEND, find_parts, jump_limit
from pipeline.models.symbolic.perceive import CLEAR_SHARE, SEEN_SHARE, perceive
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View
from tests.models.symbolic_painting import HEIGHT, WIDTH, Box, paint, room

TRIMMED = 0.08
"""Share of an extent that trimming may take: 4 % at each end."""
SURFACE_M = 0.03
"""Trimmed extents fall short of a painted box by less than this, a pixel or two at these distances."""


def only(view: View, name: str) -> Thing:
    found = view.named(frozenset({name}))
    assert len(found) == 1, f"{len(found)} {name} among {[thing.name for thing in view.things]}"
    return view.things[found[0]]


def test_perceive_names_colours_and_places_a_box_in_metres() -> None:
    bed = Box("bed", (0.4, 3.0), (1.6, 0.5, 1.0), color="red")

    thing = only(perceive(paint(room(bed))), "bed")

    assert thing.color == "red"
    assert thing.clear
    assert not thing.cut
    # From above and in front the top and the front face are seen, so all three extents are.
    np.testing.assert_allclose(thing.size, (1.6, 0.5, 1.0), atol=TRIMMED * 1.6)
    np.testing.assert_allclose(thing.middle, (0.4, 0.25 - 1.5, 3.0), atol=2 * SURFACE_M)


@pytest.mark.parametrize("pitch", [0.0, 20.0, 45.0])
def test_perceive_gives_heights_along_gravity_whatever_the_pitch(pitch: float) -> None:
    table = Box("table", (0.0, 2.0), (1.0, 0.7, 0.6))

    thing = only(perceive(paint(room(table), pitch=pitch)), "table")

    assert thing.high[1] == pytest.approx(0.7 - 1.5, abs=SURFACE_M)


def test_perceive_looking_straight_down_keeps_forward_at_the_top_of_the_image() -> None:
    near, far = Box("chair", (0, -0.4), (0.3, 0.4, 0.3)), Box("stool", (0, 0.4), (0.3, 0.4, 0.3))

    view = perceive(paint(room(near, far), eye=(0, 2.5, 0), pitch=90.0))

    assert only(view, "stool").middle[2] > only(view, "chair").middle[2]


def test_perceive_below_half_a_patch_does_not_recognise_and_below_two_is_not_sure() -> None:
    sides = {"unseen": 0.02, "doubtful": 0.13, "clear": 0.4}
    views = {key: perceive(paint(room(Box("ball", (0, 3.0), (s, s, s))))) for key, s in sides.items()}

    assert not views["unseen"].named(frozenset({"ball"}))
    doubtful, clear = only(views["doubtful"], "ball"), only(views["clear"], "ball")
    assert SEEN_SHARE <= doubtful.share < CLEAR_SHARE
    assert not doubtful.clear
    assert clear.clear


def test_perceive_of_a_thing_cut_by_the_border_needs_more_of_it() -> None:
    whole = only(perceive(paint(room(Box("box", (0, 3.0), (0.2, 0.2, 0.2))))), "box")
    at_border = perceive(paint(room(Box("box", (-1.78, 3.0), (0.25, 0.2, 0.2)))))

    cut = only(at_border, "box")
    assert whole.clear
    assert cut.cut
    assert not cut.clear
    assert cut.share > 0.5 * whole.share


def test_perceive_two_chairs_one_behind_the_other_are_two_things() -> None:
    front = Box("chair", (0.0, 2.0), (0.5, 0.7, 0.4))
    back = Box("chair", (0.1, 3.0), (0.5, 1.0, 0.4))

    view = perceive(paint(room(front, back), pitch=5.0))

    assert len(view.named(frozenset({"chair"}))) == 2


def test_perceive_a_couch_cut_in_two_by_something_nearer_is_one_thing() -> None:
    couch = Box("couch", (0.0, 3.0), (2.0, 0.8, 0.8), color="blue")
    pillar = Box("column", (0.0, 2.2), (0.25, 2.5, 0.2))

    view = perceive(paint(room(couch, pillar)))

    assert only(view, "couch").size[0] == pytest.approx(2.0, rel=TRIMMED)


def test_perceive_two_chairs_with_floor_between_them_stay_two() -> None:
    chairs = [Box("chair", (x, 3.0), (0.5, 0.8, 0.5)) for x in (-0.4, 0.4)]

    assert len(perceive(paint(room(*chairs))).named(frozenset({"chair"}))) == 2


def test_perceive_shade_and_foot_of_a_lamp_are_one_thing() -> None:
    shade = Box("lamp", (0.0, 3.0), (0.4, 0.3, 0.4), foot=1.2, color="yellow")
    foot = Box("lamp", (0.0, 3.0), (0.3, 0.9, 0.3), color="yellow")

    view = perceive(paint(room(shade, foot)))

    assert only(view, "lamp").size[1] == pytest.approx(1.5, rel=TRIMMED)


def test_perceive_at_twice_the_resolution_sees_the_same_things() -> None:
    image = paint(room(Box("bed", (0, 3.2), (1.6, 0.5, 1.4), color="red"), Box("lamp", (1.2, 3.0), (0.3, 0.8, 0.3))))
    assert image.observation is not None
    grown = dataclasses.replace(
        image.observation,
        category=np.kron(image.observation.category, np.ones((4, 4), np.int32)).astype(np.int32),
        depth=np.kron(image.observation.depth, np.ones((4, 4), np.float32)),
        K=np.diag([4.0, 4.0, 1.0]) @ image.observation.K,
    )
    large = dataclasses.replace(image, color=np.kron(image.color, np.ones((4, 4, 1), np.uint8)), observation=grown)

    small_view, large_view = perceive(image), perceive(large)

    assert [t.name for t in large_view.things] == [t.name for t in small_view.things]
    for ours, theirs in zip(large_view.things[2:], small_view.things[2:], strict=True):
        np.testing.assert_allclose(ours.middle, theirs.middle, atol=0.05)


def test_perceive_without_observation_or_with_an_empty_one_sees_nothing() -> None:
    image = paint(room())
    assert image.observation is not None
    empty = dataclasses.replace(image.observation, category=np.full((HEIGHT, WIDTH), -1, np.int32))

    assert perceive(dataclasses.replace(image, observation=None)).things == ()
    assert perceive(dataclasses.replace(image, observation=empty)).things == ()


def test_perceive_ignores_categories_outside_the_vocabulary() -> None:
    image = paint(room(Box("bed", (0, 3.0), (1.6, 0.5, 1.0))))
    assert image.observation is not None
    short = dataclasses.replace(image.observation, vocabulary=image.observation.vocabulary[:10])

    assert {t.name for t in perceive(dataclasses.replace(image, observation=short)).things} <= set(short.vocabulary)


def flood(category: np.ndarray, depth: np.ndarray) -> list[int]:
    """Areas of the parts by breadth-first search, largest first: the slow and obvious way."""
    height, width = category.shape

    def on_one_surface(line: np.ndarray, at: int) -> bool:
        """Whether pixels `at` and `at + 1` of a line of depths join: close, or among four in a row on a plane."""
        if abs(line[at + 1] - line[at]) <= jump_limit(line[at + 1 : at + 2])[0]:
            return True
        with np.errstate(divide="ignore"):
            inverse = np.where(line > 0, 1 / line, 0.0)
        for first in range(max(0, at - 2), min(at, len(line) - 4) + 1):
            a, b, c, d = inverse[first : first + 4]
            if abs(a - 2 * b + c) <= BEND * b and abs(b - 2 * c + d) <= BEND * c:
                return True
        return False

    seen = (category < 0) | (depth <= 0)
    areas = []
    for start in np.argwhere(~seen):
        if seen[tuple(start)]:
            continue
        seen[tuple(start)] = True
        queue, area = deque([tuple(start)]), 0
        while queue:
            row, column = queue.popleft()
            area += 1
            for r, c in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
                if not (0 <= r < height and 0 <= c < width) or seen[r, c] or category[r, c] != category[row, column]:
                    continue
                line, at = (depth[row], min(c, column)) if r == row else (depth[:, column], min(r, row))
                if on_one_surface(line, at):
                    seen[r, c] = True
                    queue.append((r, c))
        areas.append(area)
    return sorted(areas, reverse=True)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), names=st.integers(1, 3), levels=st.integers(1, 3))
def test_find_parts_equals_a_flood_fill(seed: int, names: int, levels: int) -> None:
    rng = np.random.default_rng(seed)
    category = rng.integers(-1, names, (9, 13)).astype(np.int32)
    depth = rng.integers(0, levels + 1, (9, 13)).astype(np.float32)

    parts = find_parts(category, depth, 1, names)

    assert parts.pixels.tolist() == flood(category, depth)
    for part, (left, top, right, bottom) in enumerate(parts.bounds):
        rows, columns = np.nonzero(parts.labels == part)
        assert len(rows) == parts.pixels[part]
        assert (columns.min(), rows.min(), columns.max(), rows.max()) == (left, top, right, bottom)
        assert (category[rows, columns] == parts.category[part]).all()
    assert (
        parts.labels.ravel()[parts.sample_pixel] == np.repeat(np.arange(len(parts.pixels)), np.diff(parts.sample_begin))
    ).all()


def test_find_parts_leaves_out_what_is_too_small() -> None:
    category = np.zeros((4, 4), np.int32)
    category[0, 0] = 1

    parts = find_parts(category, np.ones((4, 4), np.float32), 2, 2)

    assert parts.category.tolist() == [0]
    assert parts.labels[0, 0] == -1
