"""Pairwise geometry of boxes against brute force, and its laws."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.layout import measure_layout

BRUTE_FORCE_STEP_M = 0.05
"""Sampling step of the brute-force outlines: their gap is at most this much too large."""

Numbers = tuple[tuple[float, float, float], tuple[float, float, float], float]

boxes = st.tuples(
    st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 2)),
    st.tuples(*[st.floats(0.05, 1.0)] * 3),
    st.floats(-4, 4),
)
"""Centre, half extents and yaw; objects are made in the test, where shape checks may draw random numbers."""


def box(numbers: Numbers) -> SceneObject:
    center, half, yaw = numbers
    return SceneObject(0, "box", "", center, half, yaw)


def outline(o: SceneObject) -> np.ndarray:
    """Points along the footprint's edges and inside it."""
    n = [max(2, int(2 * h / BRUTE_FORCE_STEP_M) + 2) for h in o.half_extents[:2]]
    x, y = np.meshgrid(*[np.linspace(-h, h, k) for h, k in zip(o.half_extents[:2], n, strict=True)])
    cos, sin = np.cos(o.yaw), np.sin(o.yaw)
    return np.stack([cos * x - sin * y + o.center[0], sin * x + cos * y + o.center[1]], axis=-1).reshape(-1, 2)


@settings(max_examples=40, deadline=None)
@given(boxes, boxes)
@example(((0.0, 0.0, 0.0), (1.0, 0.0625, 1.0), 0.0), ((0.0, 0.0, 0.0), (0.0625, 1.0, 1.0), 0.0))
def test_gap_agrees_with_brute_force(first: Numbers, second: Numbers) -> None:
    a, b = box(first), box(second)
    brute = np.linalg.norm(outline(a)[:, None] - outline(b)[None], axis=2).min()
    gap = measure_layout([a, b]).gap[0, 1]
    assert gap <= brute + 1e-9
    assert gap >= brute - 2 * BRUTE_FORCE_STEP_M


@settings(max_examples=40, deadline=None)
@given(st.lists(boxes, min_size=2, max_size=5), st.floats(-3, 3))
def test_layout_does_not_change_when_the_scene_is_turned(numbers: list[Numbers], angle: float) -> None:
    scene = [box(n) for n in numbers]
    cos, sin = np.cos(angle), np.sin(angle)
    turned = [
        SceneObject(
            o.instance,
            o.category,
            o.color,
            (cos * o.center[0] - sin * o.center[1], sin * o.center[0] + cos * o.center[1], o.center[2]),
            o.half_extents,
            o.yaw + angle,
        )
        for o in scene
    ]
    before, after = measure_layout(scene), measure_layout(turned)
    for name in ("gap", "distance", "center_distance", "vertical_gap"):
        np.testing.assert_allclose(getattr(before, name), getattr(after, name), atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.lists(boxes, min_size=1, max_size=5))
def test_gap_is_symmetric_and_overlap_of_a_thing_with_itself_is_whole(numbers: list[Numbers]) -> None:
    layout = measure_layout([box(n) for n in numbers])
    np.testing.assert_allclose(layout.gap, layout.gap.T)
    np.testing.assert_array_equal(np.diag(layout.overlap), 1.0)
    assert (layout.near >= layout.overlap).all()
    assert (layout.distance >= layout.gap).all()


def test_overlap_is_the_share_of_the_row_within_the_column() -> None:
    small = SceneObject(0, "box", "", (0.5, 0.0, 0.0), (0.5, 0.5, 0.5))
    large = SceneObject(1, "box", "", (0.0, 0.0, 0.0), (0.5, 2.0, 0.5), np.pi)
    layout = measure_layout([small, large])
    np.testing.assert_allclose(layout.overlap, [[1, 0.5], [0.125, 1]], atol=0.08)


def test_layout_of_no_objects_is_empty() -> None:
    assert measure_layout([]).gap.shape == (0, 0)
