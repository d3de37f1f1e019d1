"""The loops of the symbolic observer against plain NumPy: the same views, bit for bit, and the same colour names."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.models.messages import ImagePart, Observation
from pipeline.models.symbolic import relations
from pipeline.models.symbolic.answer_view import answer_view
from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.perceive import perceive
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View
from pipeline.scene.color_names import COLOR_NAMES, name_colors
from pipeline.scene.procedural.vocabulary import VOCABULARY
from tests.models import symbolic_reference as reference
from tests.models import symbolic_reference_relations as reference_relations
from tests.models.symbolic_painting import RGB, Box, paint, room

NAMES = ("bed", "chair", "lamp", "cabinet", "door", "box", "table", "curtain", "refrigerator", "tv", "floor", "picture")

GAP_ERROR_M = 0.005
"""Points are single precision, and their squared distance is the small rest of squared lengths of up to 100 m2; how a
library rounds between is its own."""


def assert_same(ours: View, theirs: View) -> None:
    """Compare all that is seen: values, types and bits."""
    assert [thing.name for thing in ours.things] == [thing.name for thing in theirs.things]
    for our, their in zip(ours.things, theirs.things, strict=True):
        for field in dataclasses.fields(Thing):
            assert_equal(getattr(our, field.name), getattr(their, field.name), f"{our.name}: {field.name}")
    assert ours.contacts == theirs.contacts
    assert ours.covers == theirs.covers


def assert_equal(ours: Any, theirs: Any, what: str) -> None:
    assert type(ours) is type(theirs), what
    if isinstance(ours, np.ndarray):
        assert ours.dtype == theirs.dtype, what
        assert np.array_equal(ours, theirs), what
    else:
        assert ours == theirs, what


def boxes(rng: np.random.Generator, count: int) -> list[Box]:
    """Boxes of a few names, many of them before, over or inside one another."""
    return [
        Box(
            NAMES[rng.integers(len(NAMES))],
            (rng.uniform(-1.5, 1.5), rng.uniform(1.2, 4.5)),
            (rng.uniform(0.05, 1.5), rng.uniform(0.05, 1.5), rng.uniform(0.05, 1.0)),
            foot=rng.choice([0.0, rng.uniform(0.0, 1.5)]),
            color=list(RGB)[rng.integers(len(RGB))],
        )
        for _ in range(count)
    ]


def painted(seed: int, count: int, pitch: float) -> ImagePart:
    """A room of boxes, one pixel in five of another colour."""
    rng = np.random.default_rng(seed)
    image = paint(room(*boxes(rng, count)), pitch=pitch, yaw=rng.uniform(-20, 20))
    shine = rng.integers(0, 256, image.color.shape).astype(np.uint8)
    return dataclasses.replace(image, color=np.where(rng.random(image.color.shape) < 0.2, shine, image.color))


def noise(seed: int, grain: int, stride: int) -> ImagePart:
    """Categories and depths at random, in squares of `grain` pixels."""
    rng = np.random.default_rng(seed)
    height, width = 240 * stride - 5 * (stride > 1), 320 * stride
    rough = rng.integers(-2, 8, (height // grain + 1, width // grain + 1))
    category = np.kron(rough, np.ones((grain, grain), int))[:height, :width].astype(np.int32)
    tilt = rng.normal(0, 0.02, 2)
    depth = 2.0 + tilt[0] * np.arange(width) + tilt[1] * np.arange(height)[:, None] + rng.integers(0, 2, category.shape)
    seen = Observation(
        category,
        np.clip(depth, 0, None).astype(np.float32),
        np.array([[280.0 * stride, 0, width / 2], [0, 280.0 * stride, height / 2], [0, 0, 1]]),
        np.array([0.1, -0.9, -0.3]),
        ("bed", "lamp", "cabinet", "door", "wall", "chair"),
    )
    return ImagePart(rng.integers(0, 256, (height, width, 3)).astype(np.uint8), seen)


@pytest.mark.parametrize(("seed", "count", "pitch"), [(0, 0, 5.0), (1, 8, 15.0), (2, 14, -10.0), (3, 10, 40.0)])
def test_perceive_and_pairs_of_painted_rooms_equal_the_reference(seed: int, count: int, pitch: float) -> None:
    image = painted(seed, count, pitch)
    view = perceive(image)

    assert_same(view, reference.perceive(image))
    assert_stand_as_in_the_reference(view)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 14), pitch=st.sampled_from([-10.0, 5.0, 15.0, 40.0, 90.0]))
def test_perceive_and_pairs_of_any_room_equal_the_reference(seed: int, count: int, pitch: float) -> None:
    test_perceive_and_pairs_of_painted_rooms_equal_the_reference(seed, count, pitch)


@pytest.mark.parametrize(("seed", "grain", "stride"), [(0, 1, 1), (1, 4, 3), (2, 16, 1)])
def test_perceive_and_pairs_of_noise_equal_the_reference(seed: int, grain: int, stride: int) -> None:
    image = noise(seed, grain, stride)
    view = perceive(image)

    assert_same(view, reference.perceive(image))
    assert_stand_as_in_the_reference(dataclasses.replace(view, things=view.things[:12]))


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), grain=st.sampled_from([1, 4, 16]), stride=st.sampled_from([1, 3]))
def test_perceive_and_pairs_of_any_noise_equal_the_reference(seed: int, grain: int, stride: int) -> None:
    test_perceive_and_pairs_of_noise_equal_the_reference(seed, grain, stride)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (2, 3), (3, 4)])
def test_perceive_of_a_few_pixels_equals_the_reference(size: tuple[int, int]) -> None:
    seen = Observation(np.zeros(size, np.int32), np.ones(size, np.float32), np.eye(3), np.array([0.0, -1, 0]), ("bed",))
    image = ImagePart(np.zeros((*size, 3), np.uint8), seen)

    assert_same(perceive(image), reference.perceive(image))


def test_name_color_equals_the_names_of_every_16th_level_and_their_neighbours() -> None:
    levels = np.unique(np.clip(np.add.outer(np.arange(0, 257, 16), (-1, 0, 1)), 0, 255)).astype(np.uint8)

    assert_colors_equal(np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3))


@pytest.mark.slow
def test_name_color_equals_the_names_of_all_colours() -> None:
    rest = np.stack(np.meshgrid(np.arange(256), np.arange(256), indexing="ij"), axis=-1).reshape(-1, 2)
    for red in range(256):
        assert_colors_equal(np.insert(rest, 0, red, axis=1).astype(np.uint8))


def assert_colors_equal(rgb: np.ndarray) -> None:
    from pipeline.models.symbolic.things_kernels import name_samples

    names, brightest = name_samples(np.arange(len(rgb)), len(rgb), 1, rgb[None])
    np.testing.assert_array_equal(names, name_colors(rgb / 255.0))
    np.testing.assert_array_equal(brightest, rgb.max(axis=1))
    assert names.max() < len(COLOR_NAMES)


def assert_stand_as_in_the_reference(view: View) -> None:
    """Compare every pair; contacts of things that a view was cut by are left out."""
    count = len(view.things)
    shown = {pair: share for pair, share in view.contacts.items() if max(pair) < count}
    view = View(view.things, shown, view.covers)
    for a, b in np.ndindex(count, count):
        gap = reference_relations.gap_m(view.things[a], view.things[b])
        assert relations.gap_m(view, a, b) == relations.gap_m(view, b, a) == pytest.approx(gap, abs=GAP_ERROR_M)
        assert relations.gaps_m(view, a)[b] == relations.gap_m(view, a, b)
        if a != b:
            for name in ("on", "inside", "under", "above", "behind"):
                ours, theirs = (getattr(module, name)(view, a, b) for module in (relations, reference_relations))
                assert ours == theirs, (name, view.things[a].name, view.things[b].name)
            assert relations.next_to(view, a, b) == pytest.approx(reference_relations.next_to(view, a, b), abs=0.01)


def test_answers_kept_with_a_view_are_those_of_their_question() -> None:
    image = paint(room(Box("chair", (0, 3.0), (0.5, 0.8, 0.5), color="red")))
    questions = [f"What color is the {name}?" for name in ("chair", "bed", "wall", "floor", "table", "lamp")]
    kept = perceive(image)

    for question in (*questions, *questions[::-1], *questions):
        query = parse_question(question, VOCABULARY)
        assert answer_view(query, kept) == answer_view(query, perceive(image))
