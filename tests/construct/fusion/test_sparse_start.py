"""A start from sparse points: scales from neighbours, and points that nobody can use."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.fusion.sparse_start import WIDEST_SHARE, start_from_points
from pipeline.geometry import Camera
from pipeline.scene.captures import SparsePoints
from schemas.errors import InputError
from tests.render.scenes import front_camera

AWAY_M = 4.0


def sheet(steps: int = 7, spacing: float = 0.2) -> SparsePoints:
    """A square grid of points that faces the camera at the origin, redder to the right."""
    at = (np.arange(steps) - steps // 2) * spacing
    x, y = np.meshgrid(at, at, indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.full(x.size, AWAY_M)], axis=1)
    colors = np.stack([np.linspace(0, 255, x.size), np.full(x.size, 10), np.full(x.size, 20)], axis=1)
    return SparsePoints(positions, colors.astype(np.uint8))


def with_points(points: SparsePoints, more: list[list[float]]) -> SparsePoints:
    colors = np.full((len(more), 3), 200, np.uint8)
    return SparsePoints(np.concatenate([points.positions, more]), np.concatenate([points.colors, colors]))


@pytest.fixture
def camera() -> Camera:
    return front_camera()


def test_scale_is_the_root_mean_square_distance_to_three_neighbours(camera: Camera) -> None:
    points = sheet()
    made = start_from_points(points, [camera])
    between = np.linalg.norm(points.positions[:, None] - points.positions[None], axis=2)
    expected = np.sqrt((np.sort(between, axis=1)[:, 1:4] ** 2).mean(axis=1))
    np.testing.assert_allclose(np.exp(made.log_scales), np.repeat(expected[:, None], 3, axis=1), rtol=1e-5)


def test_positions_colors_and_opacity_are_those_of_the_points(camera: Camera) -> None:
    points = sheet()
    made = start_from_points(points, [camera])
    np.testing.assert_array_equal(made.means, points.positions.astype(np.float32))
    np.testing.assert_allclose(0.5 + 0.28209479177387814 * made.sh[:, 0], points.colors / 255, atol=1e-6)
    np.testing.assert_allclose(1 / (1 + np.exp(-made.opacity_logits)), 0.1, rtol=1e-5)


def test_points_that_no_camera_sees_are_left_out(camera: Camera) -> None:
    behind, beside = [0.0, 0.0, -AWAY_M], [50.0, 0.0, AWAY_M]
    made = start_from_points(with_points(sheet(), [behind, beside, [np.nan, 0, 1], [np.inf, 0, 1]]), [camera])
    np.testing.assert_array_equal(made.means, sheet().positions.astype(np.float32))


def test_points_alone_by_far_are_left_out_and_widen_nobody(camera: Camera) -> None:
    alone = [0.0, 0.0, 0.2]
    plain, made = (start_from_points(p, [camera]) for p in (sheet(), with_points(sheet(), [alone])))
    np.testing.assert_array_equal(made.means, plain.means)
    np.testing.assert_array_equal(made.log_scales, plain.log_scales)


def test_points_at_one_place_become_one(camera: Camera) -> None:
    points = sheet()
    doubled = SparsePoints(np.repeat(points.positions, 2, axis=0), np.repeat(points.colors, 2, axis=0))
    plain, made = (start_from_points(p, [camera]) for p in (points, doubled))
    np.testing.assert_array_equal(made.means, plain.means)
    np.testing.assert_array_equal(made.log_scales, plain.log_scales)


def test_no_gaussian_is_wider_than_a_share_of_its_distance(camera: Camera) -> None:
    made = start_from_points(sheet(3, 1.2), [camera])
    assert np.exp(made.log_scales).max() <= WIDEST_SHARE * np.linalg.norm([1.2, 1.2, AWAY_M]) * 1.00001


@pytest.mark.parametrize("count", [0, 3])
def test_too_few_points_are_refused(camera: Camera, count: int) -> None:
    points = sheet()
    with pytest.raises(InputError, match="at least 4"):
        start_from_points(SparsePoints(points.positions[:count], points.colors[:count]), [camera])


def test_no_camera_is_refused() -> None:
    with pytest.raises(InputError, match="cameras"):
        start_from_points(sheet(), [])
