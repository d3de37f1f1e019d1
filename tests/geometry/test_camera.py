"""The camera by its laws: project and unproject, pixel centres, resizing, and what it refuses."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geometry import Camera, points_in_frustum
from schemas.errors import InputError
from tests.geometry.making import camera, seeds

K = np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]])
POSE = np.eye(4)[:3]


@given(seeds)
def test_unproject_then_project_gives_the_pixel_centres(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made = camera(rng)
    depth = rng.uniform(0.3, 20, (made.height, made.width))
    local = made.unproject(depth).reshape(-1, 3)
    world = (local - made.world_to_camera[:, 3]) @ made.world_to_camera[:, :3]
    pixels, depths = made.project(world)
    grid = np.stack(np.meshgrid(np.arange(made.width) + 0.5, np.arange(made.height) + 0.5), axis=-1)
    np.testing.assert_allclose(pixels, grid.reshape(-1, 2), atol=1e-7)
    np.testing.assert_allclose(depths, depth.reshape(-1), atol=1e-9)


@given(seeds)
def test_centre_and_forward_agree_with_the_pose(seed: int) -> None:
    made = camera(np.random.default_rng(seed))
    np.testing.assert_allclose(made.camera_to_world[:, 3], made.center, atol=1e-9)
    np.testing.assert_allclose(made.camera_to_world[:, 2], made.forward, atol=1e-12)
    pixels, depth = made.project((made.center + 2.5 * made.forward)[None])
    np.testing.assert_allclose(pixels[0], made.K[:2, 2], atol=1e-6)
    assert depth[0] == pytest.approx(2.5)


def test_x_is_right_y_is_down_z_is_ahead() -> None:
    pixels, depth = Camera(K, POSE, 64, 48).project(np.array([[0.1, 0, 1], [0, 0.1, 1], [0, 0, 2.0]]))
    np.testing.assert_allclose(pixels, [[42, 24], [32, 34], [32, 24]])
    np.testing.assert_allclose(depth, [1, 1, 2])


def test_points_at_and_behind_the_camera_have_no_pixel() -> None:
    pixels, depth = Camera(K, POSE, 64, 48).project(np.array([[0, 0, 0], [1, 1, -1.0]]))
    assert np.isnan(pixels).all()
    np.testing.assert_allclose(depth, [0, -1])


@given(seeds, st.integers(1, 400), st.integers(1, 400))
def test_resizing_scales_pixels_and_keeps_the_field_of_view(seed: int, width: int, height: int) -> None:
    rng = np.random.default_rng(seed)
    made = camera(rng)
    other = made.resized(width, height)
    point = (made.center + made.forward * 3 + rng.normal(size=3) * 0.3)[None]
    (a, _), (b, _) = made.project(point), other.project(point)
    scale = np.array([width / made.width, height / made.height])
    np.testing.assert_allclose(b, a * scale, rtol=1e-9, atol=1e-6)
    assert (other.width, other.height) == (width, height)


@given(seeds)
def test_moved_camera_has_the_same_lens(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made, other = camera(rng), camera(rng)
    moved = made.moved_to(other.world_to_camera)
    np.testing.assert_array_equal(moved.K, made.K)
    np.testing.assert_allclose(moved.center, other.center)


@given(seeds)
def test_frustum_holds_exactly_the_points_with_a_pixel_between_the_planes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made = camera(rng)
    points = made.center + rng.normal(size=(200, 3)) * 5
    inside = points_in_frustum(made, points, near_m=1.0, far_m=6.0)
    for point, found in zip(points, inside, strict=True):
        x, y, z = made.world_to_camera[:, :3] @ point + made.world_to_camera[:, 3]
        u, v = made.K[0, 0] * x / z + made.K[0, 2], made.K[1, 1] * y / z + made.K[1, 2]
        assert found == (1 < z <= 6 and 0 <= u < made.width and 0 <= v < made.height)


def test_frustum_takes_nothing_behind_the_camera_or_at_it() -> None:
    made = Camera(K, POSE, 64, 48)
    points = np.array([[0, 0, 1], [0, 0, -1], [0, 0, 0.0], [0, 0, 0.1], [0, 0, 101]])
    assert points_in_frustum(made, points).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"K": np.diag([0.0, 1, 1])}, "K"),
        ({"K": np.diag([100.0, -1, 1])}, "K"),
        ({"K": K + np.array([[0, 1, 0], [0, 0, 0], [0, 0, 0]])}, "K"),
        ({"K": K * np.nan}, "K"),
        ({"width": 0}, "size"),
        ({"height": -3}, "size"),
        ({"world_to_camera": POSE * 2}, "pose"),
        ({"world_to_camera": POSE * np.nan}, "pose"),
    ],
)
def test_impossible_camera_is_an_input_error(change: dict[str, object], field: str) -> None:
    arguments = {"K": K, "world_to_camera": POSE, "width": 64, "height": 48, **change}
    with pytest.raises(InputError) as caught:
        Camera(**arguments)  # type: ignore[arg-type]
    assert caught.value.field == field


def test_camera_copies_what_it_is_given_and_cannot_be_changed() -> None:
    given_K = K.copy()
    made = Camera(given_K, POSE, 64, 48)
    given_K[0, 0] = 5
    assert made.K[0, 0] == 100
    with pytest.raises(ValueError, match="read-only"):
        made.K[0, 0] = 5
    with pytest.raises(FrozenInstanceError):
        made.width = 3  # type: ignore[misc]


def test_camera_survives_pickling() -> None:
    made = camera(np.random.default_rng(0))
    back = pickle.loads(pickle.dumps(made))
    np.testing.assert_array_equal(back.K, made.K)
    np.testing.assert_array_equal(back.world_to_camera, made.world_to_camera)
