"""Quaternions by their laws: norm, both ways and back, the same rotation for q and -q, products, extremes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geometry import normalise_quats, quats_to_rotations, rotations_to_quats
from tests.geometry.making import rotation, seeds

TOLERANCE = 1e-12
"""A few roundings of float64 numbers of size 1."""


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    w, x, y, z = p
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]) @ q


@given(seeds)
def test_matrices_are_rotations(seed: int) -> None:
    R = quats_to_rotations(np.random.default_rng(seed).normal(size=(5, 4)))
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), (5, 3, 3)), atol=TOLERANCE)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=TOLERANCE)


@given(seeds)
def test_rotations_to_quats_and_back_is_the_same_rotation(seed: int) -> None:
    R = np.stack([rotation(np.random.default_rng([seed, i])) for i in range(5)])
    quats = rotations_to_quats(R)
    np.testing.assert_allclose(quats_to_rotations(quats), R, atol=TOLERANCE)
    assert (quats[:, 0] >= 0).all()


@given(seeds)
def test_product_of_quaternions_is_product_of_rotations(seed: int) -> None:
    p, q = normalise_quats(np.random.default_rng(seed).normal(size=(2, 4)))
    np.testing.assert_allclose(
        quats_to_rotations(product(p, q)), quats_to_rotations(p) @ quats_to_rotations(q), atol=TOLERANCE
    )


@given(seeds, st.floats(-150, 150))
def test_sign_and_length_do_not_matter(seed: int, exponent: float) -> None:
    q = np.random.default_rng(seed).normal(size=4)
    np.testing.assert_allclose(quats_to_rotations(-q * 10.0**exponent), quats_to_rotations(q), atol=TOLERANCE)


@pytest.mark.parametrize(
    ("quat", "moved"),
    [
        ((1, 0, 0, 0), (1, 2, 3)),
        ((0, 1, 0, 0), (1, -2, -3)),
        ((0, 0, 1, 0), (-1, 2, -3)),
        ((0, 0, 0, 1), (-1, -2, 3)),
        ((1, 0, 0, 1), (-2, 1, 3)),
        ((1, 1, 0, 0), (1, -3, 2)),
        ((1, 0, 1, 0), (3, 2, -1)),
    ],
)
def test_known_turns_of_a_point(quat: tuple[int, ...], moved: tuple[int, ...]) -> None:
    turned = quats_to_rotations(np.array(quat, float)) @ np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(turned, moved, atol=TOLERANCE)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [np.pi, np.pi - 1e-9, 1e-9, 0.0])
def test_half_turns_and_tiny_turns_come_back(axis: int, angle: float) -> None:
    quat = np.zeros(4)
    quat[0], quat[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    back = rotations_to_quats(quats_to_rotations(quat))
    np.testing.assert_allclose(np.abs(back @ quat), 1, atol=TOLERANCE)
    np.testing.assert_allclose(quats_to_rotations(back), quats_to_rotations(quat), atol=TOLERANCE)


def test_zero_is_the_identity_among_others() -> None:
    quats = normalise_quats(np.array([[0.0, 0, 0, 0], [0, 3, 0, 4]]))
    np.testing.assert_array_equal(quats, [[1, 0, 0, 0], [0, 0.6, 0, 0.8]])


@pytest.mark.parametrize("size", [1e-300, 1e-25, 1e25, 1e300])
def test_extreme_norms_keep_full_precision(size: float) -> None:
    np.testing.assert_allclose(normalise_quats(np.full(4, size)), 0.5, rtol=1e-15)


def test_float32_input_is_worked_in_float64_and_left_alone() -> None:
    given_quats = np.array([[2, 0, 0, 0]], np.float32)
    assert normalise_quats(given_quats).dtype == np.float64
    assert given_quats[0, 0] == 2


def test_leading_axes_are_kept() -> None:
    assert quats_to_rotations(np.ones((2, 5, 4))).shape == (2, 5, 3, 3)
    assert rotations_to_quats(np.broadcast_to(np.eye(3), (2, 5, 3, 3))).shape == (2, 5, 4)
    assert normalise_quats(np.zeros((0, 4))).shape == (0, 4)
