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
from pipeline.models.symbolic.perceive import Thing, View, perceive
from pipeline.scene.color_names import COLOR_NAMES, name_colors
from pipeline.scene.procedural.vocabulary import VOCABULARY
from tests.models import symbolic_reference as reference
from tests.models.symbolic_painting import RGB, Box, paint, room

NAMES = ("bed", "chair", "lamp", "cabinet", "door", "box", "table", "curtain", "refrigerator", "tv", "floor", "picture")


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


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 14), pitch=st.sampled_from([-10.0, 5.0, 15.0, 40.0, 90.0]))
def test_perceive_of_painted_rooms_equals_the_reference(seed: int, count: int, pitch: float) -> None:
    rng = np.random.default_rng(seed)
    image = paint(room(*boxes(rng, count)), pitch=pitch, yaw=rng.uniform(-20, 20))
    shine = rng.integers(0, 256, image.color.shape).astype(np.uint8)
    image = dataclasses.replace(image, color=np.where(rng.random(image.color.shape) < 0.2, shine, image.color))

    assert_same(perceive(image), reference.perceive(image))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), grain=st.sampled_from([1, 4, 16]), stride=st.sampled_from([1, 3]))
def test_perceive_of_noise_equals_the_reference(seed: int, grain: int, stride: int) -> None:
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
    image = ImagePart(rng.integers(0, 256, (height, width, 3)).astype(np.uint8), seen)

    assert_same(perceive(image), reference.perceive(image))


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


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_gap_m_equals_the_norm_of_the_boxes_or_the_nearest_points_whichever_is_asked_first(seed: int) -> None:
    view = perceive(paint(room(*boxes(np.random.default_rng(seed), 6))))

    for a, first in enumerate(view.things):
        for b, second in enumerate(view.things):
            apart = np.maximum(0.0, np.maximum(first.low - second.high, second.low - first.high))
            expected = float(np.linalg.norm(apart))
            if expected <= relations.NEAR_M and len(first.points) and len(second.points):
                squared = (first.points**2).sum(axis=1)[:, None] + (second.points**2).sum(axis=1)
                squared = squared - 2.0 * first.points @ second.points.T
                nearest = float(np.sqrt(max(0.0, float(squared.min())))) - relations.POINT_SPACING_M
                expected = max(expected, nearest)
            assert relations.gap_m(view, a, b) == expected
            assert relations.gap_m(view, a, b) == expected


def test_answers_kept_with_a_view_are_those_of_their_question() -> None:
    image = paint(room(Box("chair", (0, 3.0), (0.5, 0.8, 0.5), color="red")))
    questions = [f"What color is the {name}?" for name in ("chair", "bed", "wall", "floor", "table", "lamp")]
    kept = perceive(image)

    for question in (*questions, *questions[::-1], *questions):
        query = parse_question(question, VOCABULARY)
        assert answer_view(query, kept) == answer_view(query, perceive(image))
