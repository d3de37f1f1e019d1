"""A simulated depth camera: how far off it is, and where it sees nothing."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.simulated.depth_sensor import BASELINE_M, FOCAL_PX, RANGE_M, STEPS_PER_PIXEL, structured_light
from pipeline.geometry import Camera
from schemas.errors import InputError

CAMERA = Camera(np.array([[256.0, 0, 160], [0, 256.0, 120], [0, 0, 1]]), np.eye(4)[:3], 320, 240)


def wall(depth_m: float) -> np.ndarray:
    return np.full((CAMERA.height, CAMERA.width), depth_m, np.float32)


def seen(true: np.ndarray, **settings: np.ndarray) -> np.ndarray:
    return structured_light(true, CAMERA, np.random.default_rng(0), **settings)


@pytest.mark.parametrize("away_m", [1.0, 2.5, 4.5])
def test_flat_wall_is_off_by_at_most_a_step_of_disparity(away_m: float) -> None:
    found = seen(wall(away_m))
    step_m = away_m**2 / (FOCAL_PX * BASELINE_M * STEPS_PER_PIXEL)
    assert (found > 0).all()
    # Half a step of rounding and five deviations of a sixth of a step.
    assert np.abs(found - away_m).max() < 1.4 * step_m
    assert len(np.unique(found)) > 1


def test_nothing_is_measured_out_of_range_or_where_nothing_is() -> None:
    for away_m in (RANGE_M[0] - 0.05, RANGE_M[1] + 0.1, 0.0):
        assert not seen(wall(away_m)).any()


def test_board_before_a_wall_casts_a_shadow_on_its_left_as_wide_as_the_disparities_differ() -> None:
    true = wall(4.0)
    true[:, 100:200] = 1.0
    found = seen(true)
    expected = CAMERA.K[0, 0] * BASELINE_M * (1 / 1.0 - 1 / 4.0)
    # Whichever pixel looks at the board's edge is grazed and lost, too.
    assert (found[:, 100 - int(expected) + 1 : 100] == 0).all()
    assert (found[:, : 100 - int(expected) - 2] > 0).all()
    assert (found[:, 203:] > 0).all()


def test_grazed_floor_is_lost_far_away_only() -> None:
    rows = np.arange(CAMERA.height) + 0.5
    height_m = 0.3
    slope = (rows - CAMERA.K[1, 2]) / CAMERA.K[1, 1]
    true = np.where(slope > 0, height_m / np.where(slope > 0, slope, 1), 0.0)
    found = seen(np.repeat(true[:, None], CAMERA.width, axis=1).astype(np.float32))
    assert (found[np.flatnonzero((true > 0) & (true < 1.2))[:-1]] > 0).mean() > 0.99
    assert not found[np.flatnonzero((true > 2.6) & (true < RANGE_M[1]))].any()


def test_blind_pixels_have_no_depth_and_the_same_seed_gives_the_same_image() -> None:
    blind = np.zeros((CAMERA.height, CAMERA.width), bool)
    blind[50:60, 50:60] = True
    found = seen(wall(2.0), blind=blind)
    assert not found[blind].any()
    np.testing.assert_array_equal(found, seen(wall(2.0), blind=blind))


def test_image_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match="320 x 240"):
        structured_light(np.ones((5, 5), np.float32), CAMERA, np.random.default_rng(0))
