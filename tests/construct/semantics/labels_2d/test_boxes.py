"""Boxes become the thing in their middle: what lies far behind, before or beyond a jump of depth is left out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.construct.semantics.labels_2d.boxes import Detection, paint, thing_in_box

FOCAL = 100.0


def chair_before_wall() -> np.ndarray:
    """A thing of 20 x 20 pixels at 2 m before a wall at 4 m."""
    depth = np.full((40, 40), 4.0, np.float32)
    depth[10:30, 10:30] = 2.0
    return depth


def test_box_keeps_the_thing_and_drops_the_wall() -> None:
    mask = thing_in_box(chair_before_wall(), slice(5, 35), slice(5, 35), FOCAL)
    assert mask[5:25, 5:25].all()
    assert mask.sum() == 400


def test_something_in_front_of_the_corner_is_dropped() -> None:
    depth = chair_before_wall()
    depth[22:40, 0:14] = 0.5
    mask = thing_in_box(depth, slice(5, 35), slice(5, 35), FOCAL)
    assert not mask[20:, :7].any()
    assert mask[5:15, 5:25].all()


def test_a_slanted_surface_stays_whole() -> None:
    depth = np.tile(np.linspace(1.9, 2.1, 30, dtype=np.float32), (30, 1))
    assert thing_in_box(depth, slice(0, depth.shape[0]), slice(0, depth.shape[1]), FOCAL).all()


def test_two_legs_that_show_in_the_core_both_count() -> None:
    depth = np.full((40, 40), 4.0, np.float32)
    depth[:, 12:17] = 2.0
    depth[:, 23:28] = 2.0
    mask = thing_in_box(depth, slice(0, depth.shape[0]), slice(0, depth.shape[1]), FOCAL)
    assert mask[:, 12:17].all()
    assert mask[:, 23:28].all()
    assert not mask[:, :12].any()


def test_a_box_without_depth_in_its_core_stays_whole() -> None:
    assert thing_in_box(np.zeros((8, 9), np.float32), slice(0, 8), slice(0, 9), FOCAL).all()


def on_a_floor() -> tuple[np.ndarray, np.ndarray]:
    """Depth of a block that stands on a floor 1.5 m under the camera, and which pixels are the block's."""
    v, u = np.mgrid[0:120, 0:160] + 0.5
    floor = 1.5 * FOCAL / np.maximum(v - 30, 1e-3)
    block = (u > 60) & (u < 100) & (v > 40) & (v < 90)
    depth = np.where(v > 55, floor, 0.0)
    return np.where(block, 2.5, depth).astype(np.float32), block


def test_the_floor_a_thing_stands_on_is_left_out() -> None:
    depth, block = on_a_floor()
    mask = thing_in_box(depth, slice(38, 100), slice(50, 110), FOCAL)
    own = block[38:100, 50:110]
    assert mask[own].mean() > 0.95
    assert mask[~own].mean() < 0.05


def test_a_table_larger_than_its_box_stays() -> None:
    depth, _ = on_a_floor()
    depth = np.where(depth > 0, depth, 0).astype(np.float32)
    depth[:, 60:100] = depth[:, :40]
    mask = thing_in_box(depth, slice(70, 110), slice(40, 120), FOCAL)
    assert mask.mean() > 0.9


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_any_depth_gives_a_mask_of_pixels_with_depth_or_the_whole_box(height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random((height, width)) < 0.3, 0, rng.uniform(0.5, 5, (height, width))).astype(np.float32)
    mask = thing_in_box(depth, slice(0, depth.shape[0]), slice(0, depth.shape[1]), FOCAL)
    assert mask.shape == depth.shape
    assert mask.any()
    assert mask.all() or not mask[depth == 0].any()


def test_the_surer_of_two_boxes_lies_on_top() -> None:
    image = paint([Detection(3, 0.9, (0.0, 0.0, 6.0, 6.0)), Detection(1, 0.5, (4.0, 4.0, 10.0, 10.0))], (8, 12))
    assert image.category[5, 5] == 3
    assert image.category[7, 9] == 1
    assert image.category[0, 11] == -1
    assert image.confidence is not None
    assert image.confidence[5, 5] == np.float32(0.9)
    assert image.confidence[0, 11] == 0


def test_masks_replace_boxes() -> None:
    mask = np.zeros((8, 12), bool)
    mask[2:4, 2:4] = True
    image = paint([Detection(0, 0.9, (0.0, 0.0, 6.0, 6.0), mask)], (8, 12), np.ones((8, 12), np.float32), FOCAL)
    assert ((image.category == 0) == mask).all()


@pytest.mark.parametrize(
    "box", [(-5.0, -5.0, 3.0, 3.0), (10.0, 6.0, 50.0, 50.0), (20.0, 20.0, 30.0, 30.0), (5.0, 5.0, 5.0, 5.0)]
)
def test_boxes_over_the_edge_are_cut(box: tuple[float, float, float, float]) -> None:
    image = paint([Detection(0, 0.9, box)], (8, 12), np.ones((8, 12), np.float32), FOCAL)
    assert (image.category == 0).sum() in (9, 4, 0)
