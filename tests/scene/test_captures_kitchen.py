"""The real kitchen: what one frame's depth says, its neighbours' depth confirms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.captures import Capture, Frame, open_capture, read_seven_scenes
from tests.scene.box_room import world_points

AGREE_M = 0.03
"""Kinect depth at 2 m is good to about a centimetre, and the poses come from KinectFusion."""


@pytest.fixture
def kitchen(shared_data: Path) -> Capture:
    return open_capture(str(shared_data / "kitchen_7scenes"))


def disagreement_m(first: Frame, second: Frame, axes: tuple[int, int, int] = (1, 1, 1)) -> float:
    """Return the median difference between the first's depth seen from the second, and the second's own."""
    depth = first.read_depth()[::4, ::4]
    points = world_points(first.depth_lens.resized(160, 120), depth)[depth > 0]
    local = points @ second.depth_lens.world_to_camera[:, :3].T + second.depth_lens.world_to_camera[:, 3]
    z = (local * axes)[:, 2]
    pixels = (local * axes)[:, :2] / z[:, None] * np.diag(second.depth_lens.K)[:2] + second.depth_lens.K[:2, 2]
    inside = (z > 0) & (pixels >= 0).all(axis=1) & (pixels < (640, 480)).all(axis=1)
    if inside.sum() < 1000:
        return np.inf
    columns, rows = pixels[inside].astype(int).T
    found = second.read_depth()[rows, columns]
    return float(np.median(np.abs(found - z[inside])[found > 0]))


def test_the_whole_capture_loads(kitchen: Capture) -> None:
    assert len(kitchen) == 100
    assert kitchen.skipped == ()
    assert kitchen.frames[0].depth_lens.K[0, 0] == 585
    assert kitchen.frames[3].name == "frame-000030"


def test_depth_is_metres_without_the_invalid_numbers(kitchen: Capture) -> None:
    depth = np.stack([frame.read_depth() for frame in kitchen.frames[::20]])
    assert 0.02 < (depth == 0).mean() < 0.5
    assert depth.max() < 10
    assert depth[depth > 0].min() > 0.4


def test_neighbouring_frames_agree_on_depth(kitchen: Capture) -> None:
    pairs = zip(kitchen.frames[::6], kitchen.frames[1::6], strict=False)
    assert np.median([disagreement_m(a, b) for a, b in pairs]) < AGREE_M


def test_neighbouring_frames_disagree_in_opengl_axes(kitchen: Capture) -> None:
    pairs = zip(kitchen.frames[::12], kitchen.frames[1::12], strict=False)
    assert np.median([disagreement_m(a, b, (1, -1, 1)) for a, b in pairs]) > 3 * AGREE_M


def edge_contrast(frame: Frame) -> float:
    """Return how much stronger the photograph's gradient is where depth has an edge than elsewhere."""
    depth = frame.read_depth()
    grey = frame.read_image().astype(float).mean(axis=2)
    gradient = np.hypot(*np.gradient(grey))
    farther = np.maximum(np.roll(depth, 1, axis=1), np.roll(depth, -1, axis=1))
    edge = (depth > 0) & (depth < 3) & (farther - depth > 0.08)
    pixels, _ = frame.camera.project(world_points(frame.depth_lens, depth)[edge])
    columns, rows = np.floor(pixels).astype(int).T
    inside = (columns >= 0) & (columns < 640) & (rows >= 0) & (rows < 480)
    return float(gradient[rows[inside], columns[inside]].mean() / gradient.mean())


def test_photographs_have_edges_where_depth_has_them(kitchen: Capture, shared_data: Path) -> None:
    plain = read_seven_scenes(str(shared_data / "kitchen_7scenes"), register=False)
    registered = np.mean([edge_contrast(frame) for frame in kitchen.frames[::10]])
    as_given = np.mean([edge_contrast(frame) for frame in plain.frames[::10]])
    assert registered > 1.6 * as_given
