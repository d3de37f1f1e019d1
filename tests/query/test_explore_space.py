from __future__ import annotations

import numpy as np
import pytest

from pipeline.query.explore_config import ExploreConfig
from pipeline.query.explore_space import FreeSpace, map_space
from pipeline.scene.gaussians import Gaussians
from tests.query.tiny import UP, box_points, gaussians_at

CONFIG = ExploreConfig(clearance_m=0.2, reach_m=1.5, height_margin_m=0.4)
CENTERS = np.array([[-1.0, 0.0, 1.2], [-0.6, 0.0, 1.3]])


def _walled() -> Gaussians:
    """A closed room from -2 to 2 with a post in it; the cameras stand to its left."""
    walls = [
        box_points((sign * 2 * axis[0], sign * 2 * axis[1], 1.2), (2 * axis[1], 2 * axis[0], 1.2), 0.08)
        for axis in ((1, 0), (0, 1))
        for sign in (-1, 1)
    ]
    post = box_points((0.0, 0.0, 1.2), (0.1, 0.1, 1.2), 0.05)
    return gaussians_at(np.concatenate([*walls, post]), scale_m=0.03)


@pytest.fixture(scope="module")
def space() -> FreeSpace:
    return map_space(_walled(), CENTERS, UP, CONFIG)


def test_recorded_centres_come_first_and_are_stands_even_where_surfaces_are_near() -> None:
    tight = map_space(gaussians_at(box_points((-1.0, 0.1, 1.2), (0.3, 0, 0.3), 0.05), 0.03), CENTERS, UP, CONFIG)
    np.testing.assert_array_equal(tight.stands[:2], CENTERS)


def test_stands_keep_clearance_reach_and_heights(space: FreeSpace) -> None:
    stands, means = space.stands[2:], _walled().means.astype(float)
    assert len(stands) > 500
    nearest = np.array([np.linalg.norm(means - stand, axis=1).min() for stand in stands[::7]])
    assert nearest.min() >= CONFIG.clearance_m - space.cell_m
    away = np.linalg.norm(stands[:, None] - CENTERS, axis=2).min(axis=1)
    assert away.max() <= CONFIG.reach_m + 1e-9
    assert stands[:, 2].min() >= 1.2 - CONFIG.height_margin_m - 1e-9
    assert stands[:, 2].max() <= 1.3 + CONFIG.height_margin_m + 1e-9


def test_places_beyond_a_wall_are_not_reached_however_near(space: FreeSpace) -> None:
    assert space.stands[:, 0].min() > -2
    assert not space.allows(np.array([[-2.3, 0.0, 1.2]]))[0]


def test_allows_what_is_free_and_nothing_outside_the_grid(space: FreeSpace) -> None:
    places = np.array([[-1.0, 0.5, 1.2], [0.0, 0.0, 1.2], [-1.85, 0.0, 1.2], [99.0, 0, 0], [-1.0, 0.5, 0.2]])
    assert space.allows(places).tolist() == [True, False, False, False, False]


def test_sight_is_cut_by_the_post_and_by_walls_only(space: FreeSpace) -> None:
    eyes = np.array([[-1.0, 0.0, 1.2], [-1.0, 1.0, 1.2]])
    points = np.array([[1.0, 0.0, 1.2], [0.0, 1.5, 1.2], [3.0, 0.5, 1.2], [-0.5, 0.0, 1.2]])
    assert space.sees(eyes, points).tolist() == [[False, True, False, True], [True, True, False, True]]


def test_a_surface_does_not_hide_its_own_points(space: FreeSpace) -> None:
    assert space.sees(np.array([[-1.0, 0.0, 1.2]]), np.array([[-2.0, 0.0, 1.2]]))[0, 0]


def test_large_flat_gaussian_blocks_all_it_covers_and_a_faint_one_nothing() -> None:
    one = gaussians_at(np.array([[0.0, 0.0, 1.2]]), scale_m=0.5)
    scales = one.log_scales.copy()
    scales[:, 0] = np.log(0.005)
    for logit, blocked in ((3.0, True), (-1.0, False)):
        wall = Gaussians(one.means, one.quats, scales, np.full(1, logit, np.float32), one.sh)
        space = map_space(wall, CENTERS, UP, CONFIG)
        seen = space.sees(np.array([[-1.0, 0.4, 1.2]]), np.array([[1.0, 0.4, 1.3]]))[0, 0]
        assert bool(seen) is not blocked


def test_open_scene_without_surfaces_is_free_within_reach() -> None:
    far = gaussians_at(np.array([[50.0, 0, 0]]))
    space = map_space(far, CENTERS[:1], UP, CONFIG)
    volume = len(space.stands[1:]) * space.cell_m**3
    radius, height = CONFIG.reach_m, CONFIG.height_margin_m
    expected = np.pi * (2 * height * radius**2 - 2 * height**3 / 3)  # a ball between two planes
    assert volume == pytest.approx(expected, rel=0.1)


def test_cells_grow_where_the_scene_is_large() -> None:
    wide = np.array([[0.0, 0, 1], [300.0, 300.0, 1]])
    space = map_space(gaussians_at(np.array([[0.0, 3, 1]])), wide, UP, CONFIG)
    assert space.blocked.size <= 9_000_000
    assert space.cell_m > CONFIG.cell_m
