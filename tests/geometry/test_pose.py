"""Poses by their laws: inverse, axes, look-at, and what is no rigid pose."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.geometry import invert_rigid, look_at, nearest_rigid, opengl_to_opencv, validate_pose
from schemas.errors import InputError
from tests.geometry.making import pose, seeds

TOLERANCE = 1e-12
UP = np.array([0.0, 0.0, 1.0])

points = st.lists(st.floats(-50, 50), min_size=3, max_size=3).map(np.array)


def apply(transform: np.ndarray, point: np.ndarray) -> np.ndarray:
    return transform[:, :3] @ point + transform[:, 3]


@given(seeds)
def test_inverse_undoes_the_pose_and_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made, point = pose(rng), rng.normal(size=3)
    np.testing.assert_allclose(apply(invert_rigid(made), apply(made, point)), point, atol=1e-11)
    np.testing.assert_allclose(invert_rigid(invert_rigid(made)), made, atol=1e-11)


@given(seeds)
def test_distances_stay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made, (a, b) = pose(rng), rng.normal(size=(2, 3))
    assert np.linalg.norm(apply(made, a) - apply(made, b)) == pytest.approx(np.linalg.norm(a - b), abs=1e-11)


@given(points, points)
def test_look_at_puts_the_target_on_the_axis_and_the_eye_at_the_origin(eye: np.ndarray, target: np.ndarray) -> None:
    distance = np.linalg.norm(target - eye)
    assume(distance > 1e-3)
    made = look_at(eye, target, UP)
    validate_pose(made, "look_at")
    np.testing.assert_allclose(apply(made, eye), 0, atol=1e-9)
    np.testing.assert_allclose(apply(made, target), [0, 0, distance], atol=1e-9)


@given(points, points)
def test_look_at_is_level_with_up_upwards(eye: np.ndarray, target: np.ndarray) -> None:
    assume(np.linalg.norm((target - eye)[:2]) > 1e-3)
    right, down, _ = look_at(eye, target, 7 * UP)[:, :3]
    assert abs(right @ UP) < 1e-9
    assert down @ UP < 0


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_look_straight_up_or_down_is_still_rigid(direction: float) -> None:
    made = look_at(np.zeros(3), direction * 3 * UP, UP)
    validate_pose(made, "look_at")
    np.testing.assert_allclose(made[2, :3], direction * UP, atol=TOLERANCE)


def test_look_at_itself_is_an_error() -> None:
    with pytest.raises(ValueError, match="two different points"):
        look_at(np.ones(3), np.ones(3), UP)


@given(seeds)
def test_opengl_to_opencv_keeps_the_centre_and_right_and_turns_the_rest(seed: int) -> None:
    made = pose(np.random.default_rng(seed))
    turned = opengl_to_opencv(made)
    np.testing.assert_array_equal(turned[:, [0, 3]], made[:, [0, 3]])
    np.testing.assert_array_equal(turned[:, 1:3], -made[:, 1:3])
    np.testing.assert_array_equal(opengl_to_opencv(turned), made)
    assert np.linalg.det(turned[:, :3]) == pytest.approx(1)


def test_opengl_to_opencv_takes_the_top_of_a_4x4() -> None:
    assert opengl_to_opencv(np.eye(4)).shape == (3, 4)


@given(seeds)
def test_valid_pose_comes_back_as_3x4_float64(seed: int) -> None:
    made = pose(np.random.default_rng(seed))
    whole = np.vstack([made, [0, 0, 0, 1]]).astype(np.float32)
    checked = validate_pose(whole, "frame")
    assert (checked.shape, checked.dtype) == ((3, 4), np.float64)
    np.testing.assert_allclose(checked, made, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda p: p * np.array([2, 2, 2, 1]), "R R"),
        (lambda p: p * np.array([1, 1, -1, 1]), "mirrored"),
        (lambda p: p + np.array([0.01, 0, 0, 0]), "R R"),
        (lambda p: np.where(p == p[0, 0], np.nan, p), "NaN"),
        (lambda p: p + np.array([0, 0, 0, np.inf]), "NaN or infinity"),
        (lambda p: p * 0, "R R"),
    ],
)
def test_what_is_not_rigid_is_refused_with_the_frame_named(change, found: str) -> None:
    with pytest.raises(InputError, match=rf"frame 7: pose: expected .*{found}"):
        validate_pose(change(pose(np.random.default_rng(0))), "frame 7")


def test_pose_of_three_decimals_passes() -> None:
    validate_pose(pose(np.random.default_rng(2)).round(3), "frame")


@given(seeds)
def test_nearest_rigid_mends_a_rounded_rotation_and_keeps_the_place(seed: int) -> None:
    made = pose(np.random.default_rng(seed))
    rounded = np.concatenate([made[:, :3].round(4), made[:, 3:]], axis=1)
    mended = nearest_rigid(rounded)
    np.testing.assert_allclose(mended[:, :3] @ mended[:, :3].T, np.eye(3), atol=TOLERANCE)
    np.testing.assert_allclose(mended[:, :3], made[:, :3], atol=2e-4)
    np.testing.assert_array_equal(mended[:, 3], made[:, 3])
