"""Free space and the walk through it: never inside things, upright, at eye height, and it sees the room."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.mesh.free_space import FloorMap, look_around, map_floor, walk
from schemas.errors import InputError

EYE_M = 1.5


def box_points(low: tuple[float, float, float], high: tuple[float, float, float], step: float = 0.04) -> np.ndarray:
    axes = [np.linspace(a, b, max(1, int((b - a) / step) + 1)) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


@pytest.fixture(scope="module")
def room() -> np.ndarray:
    """A 4 x 3 m floor with walls and a block of 1 x 1 m in the middle."""
    return np.concatenate(
        [
            box_points((0, 0, 0), (4, 3, 0)),
            box_points((0, 0, 0), (0, 3, 2.4)),
            box_points((4, 0, 0), (4, 3, 2.4)),
            box_points((0, 0, 0), (4, 0, 2.4)),
            box_points((0, 3, 0), (4, 3, 2.4)),
            box_points((1.5, 1.0, 0), (2.5, 2.0, 1.0)),
        ]
    )


@pytest.fixture(scope="module")
def floor(room: np.ndarray) -> FloorMap:
    return map_floor(room, 0.0)


def distance_to_obstacles(points: np.ndarray) -> np.ndarray:
    """Distance to the walls and to the block, metres."""
    walls = np.stack([points[:, 0], 4 - points[:, 0], points[:, 1], 3 - points[:, 1]]).min(axis=0)
    out = np.maximum(np.abs(points - [2.0, 1.5]) - 0.5, 0)
    return np.minimum(walls, np.hypot(*out.T))


def test_free_cells_keep_their_distance_to_walls_and_furniture(floor: FloorMap) -> None:
    cells = floor.centers(np.argwhere(floor.free))
    assert len(cells) > 500
    assert distance_to_obstacles(cells).min() > 0.3 - 0.08


def test_walk_stays_free_and_goes_around_the_block(floor: FloorMap) -> None:
    positions = walk(floor, 80, np.random.default_rng(0))
    assert positions.shape == (80, 2)
    assert distance_to_obstacles(positions).min() > 0.2
    assert np.ptp(positions[:, 0]) > 2.5
    assert np.ptp(positions[:, 1]) > 1.8


def test_walk_is_deterministic_by_seed(floor: FloorMap) -> None:
    first, again, other = (walk(floor, 30, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_look_around_is_level_at_eye_height_and_turns_all_ways(floor: FloorMap) -> None:
    rng = np.random.default_rng(0)
    poses = np.stack(look_around(floor, walk(floor, 90, rng), rng, eye_m=EYE_M))
    centers = -np.einsum("nij,ni->nj", poses[:, :, :3], poses[:, :, 3])
    np.testing.assert_allclose(centers[:, 2], EYE_M, atol=0.2)
    right, down, forward = poses[:, 0, :3], poses[:, 1, :3], poses[:, 2, :3]
    np.testing.assert_allclose(right[:, 2], 0.0, atol=1e-9)
    assert (down[:, 2] < -0.7).all()
    quarters = np.unique(np.floor(np.arctan2(forward[:, 1], forward[:, 0]) / (np.pi / 2)))
    assert len(quarters) == 4


def test_look_around_does_not_stare_at_a_wall_close_by(floor: FloorMap) -> None:
    rng = np.random.default_rng(0)
    positions = walk(floor, 90, rng)
    for position, pose in zip(positions, look_around(floor, positions, rng), strict=True):
        ahead = pose[2, :2] / np.linalg.norm(pose[2, :2])
        x, y = position + 0.5 * ahead
        assert 0 < x < 4, "a wall"
        assert 0 < y < 3, "a wall"
        assert not (1.55 < x < 2.45 and 1.05 < y < 1.95), "the block"


def test_separate_rooms_are_all_visited(room: np.ndarray) -> None:
    both = np.concatenate([room, room + np.array([4.0, 0.0, 0.0])])
    positions = walk(map_floor(both, 0.0), 60, np.random.default_rng(0))
    left = (positions[:, 0] < 4).sum()
    assert 15 < left < 45


def test_no_floor_or_no_room_to_stand_is_refused(room: np.ndarray) -> None:
    with pytest.raises(InputError, match="stand"):
        map_floor(room, -3.0)
    with pytest.raises(InputError, match="stand"):
        map_floor(np.concatenate([room, box_points((0, 0, 0.5), (4, 3, 0.5))]), 0.0)
