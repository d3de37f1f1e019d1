"""Laws every capture format obeys: depth lies on the walls, and what two frames see is in the same place."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.captures import Capture, open_capture
from tests.scene import box_room

DEPTH_STEP_M = 0.0011
"""Depth is written in millimetres, and rays are at most 1.2 times as long as their depth."""
JPEG_ERROR = 14
"""Of 255, on these smooth pictures."""


@pytest.fixture(params=sorted(box_room.WRITERS))
def capture(request: pytest.FixtureRequest, tmp_path: Path) -> Capture:
    return open_capture(str(box_room.WRITERS[request.param](tmp_path / request.param)))


def test_depth_of_every_format_lies_on_the_walls(capture: Capture) -> None:
    assert len(capture) == 4
    for frame in capture.frames:
        depth = frame.read_depth()
        points = box_room.world_points(frame.depth_lens, depth)[depth > 0]
        assert len(points) > 0.95 * depth.size
        assert box_room.off_walls_m(points).max() < DEPTH_STEP_M


def test_depth_is_float32_metres(capture: Capture) -> None:
    depth = capture.frames[0].read_depth()
    assert depth.dtype == np.float32
    assert 0.3 < np.median(depth) < 4


def test_points_of_one_frame_have_their_colour_in_the_next(capture: Capture) -> None:
    first, second = capture.frames[:2]
    points = box_room.world_points(first.depth_lens, first.read_depth()).reshape(-1, 3)
    points = points[first.read_depth().ravel() > 0]
    pixels, depth = second.camera.project(points)
    inside = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < (box_room.WIDTH, box_room.HEIGHT)).all(axis=1)
    assert inside.mean() > 0.5
    columns, rows = np.floor(pixels[inside]).astype(int).T
    seen = second.read_image()[rows, columns].astype(float)
    expected = points[inside] / box_room.HIGH * 255
    # A corner between walls may fall into the neighbouring pixel; all else agrees within the width of a pixel.
    assert np.percentile(np.abs(seen - expected).max(axis=1), 98) < JPEG_ERROR


def test_points_of_one_frame_have_their_depth_in_the_next(capture: Capture) -> None:
    first, second = capture.frames[:2]
    lens, image = second.depth_lens, second.read_depth()
    points = box_room.world_points(first.depth_lens, first.read_depth()).reshape(-1, 3)[first.read_depth().ravel() > 0]
    pixels, depth = lens.project(points)
    inside = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < (lens.width, lens.height)).all(axis=1)
    columns, rows = np.floor(pixels[inside]).astype(int).T
    found = image[rows, columns]
    assert np.median(np.abs(found - depth[inside])[found > 0]) < 0.03


def test_a_capture_survives_pickling_with_its_readers(capture: Capture) -> None:
    again = pickle.loads(pickle.dumps(capture))
    np.testing.assert_array_equal(again.frames[1].read_image(), capture.frames[1].read_image())
    np.testing.assert_array_equal(again.frames[1].read_depth(), capture.frames[1].read_depth())
