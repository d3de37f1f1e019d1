"""Points that photographs share: where they are, how far off, and which are left out."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.simulated.feature_points import LEAST_VIEWS, KnownFrame, feature_points
from pipeline.geometry import Camera
from schemas.errors import InputError

LENS = np.array([[100.0, 0, 80], [0, 100.0, 60], [0, 0, 1]])
WALL_M = 3.0
SQUARE_M = 0.3


def board(away_m: float) -> KnownFrame:
    """A chessboard at z = 3 for x > 0, and a plain wall left of it, seen by a camera `away_m` to the right."""
    pose = np.concatenate([np.eye(3), [[-away_m], [0.0], [0.0]]], axis=1)
    camera = Camera(LENS, pose, 160, 120)
    depth = np.full((120, 160), WALL_M, np.float32)
    x, y, _ = np.moveaxis(camera.unproject(depth), 2, 0)
    x = x + away_m
    black = (np.floor(x / SQUARE_M) + np.floor(y / SQUARE_M)).astype(int) % 2 == 0
    shade = np.where(x > 0, np.where(black, 0, 255), 60).astype(np.uint8)
    return KnownFrame(np.repeat(shade[:, :, None], 3, axis=2), depth, camera)


FRAMES = [board(away_m) for away_m in (-0.3, -0.1, 0.1, 0.3)]


def test_points_lie_on_corners_of_the_texture_within_the_noise_of_a_pixel() -> None:
    found = feature_points(FRAMES, np.random.default_rng(0)).positions
    assert len(found) > 20
    assert (found[:, 0] > -0.1).all()
    # A pixel is 3 cm there, rays differ by 4 to 11 degrees: 0.5 px across is 1 cm, along the ray up to some 10 cm.
    off = np.abs(found[:, :2] / SQUARE_M - np.round(found[:, :2] / SQUARE_M)) * SQUARE_M
    inner = found[:, 0] > SQUARE_M / 2
    assert np.median(off[inner]) < 0.03
    assert 0.005 < np.median(np.abs(found[:, 2] - WALL_M)) < 0.15


def test_what_too_few_photographs_see_is_no_point() -> None:
    with pytest.raises(InputError, match="share"):
        feature_points(FRAMES[: LEAST_VIEWS - 1], np.random.default_rng(0))


def test_photographs_from_one_place_give_no_point() -> None:
    with pytest.raises(InputError, match="share"):
        feature_points([FRAMES[0]] * 4, np.random.default_rng(0))


def test_what_stands_behind_something_is_not_seen() -> None:
    hidden = KnownFrame(FRAMES[1].photo, np.full((120, 160), 1.0, np.float32), FRAMES[1].camera)
    with pytest.raises(InputError, match="share"):
        feature_points([FRAMES[0], FRAMES[2], hidden], np.random.default_rng(0))


def test_same_seed_gives_the_same_points_and_colours_are_those_of_the_photographs() -> None:
    first, second = (feature_points(FRAMES, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first.positions, second.positions)
    assert set(np.unique(first.colors)) <= {0, 60, 255}
