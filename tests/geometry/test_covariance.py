"""Covariances by their laws: symmetric, positive, right along the axes, turned with the Gaussian, and by sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from pipeline.geometry import covariances, quats_to_rotations
from tests.geometry.making import seeds


def made(seed: int, count: int = 4) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 4)), rng.uniform(-4, 1, (count, 3))


@given(seeds)
def test_eigenvalues_are_the_squared_scales(seed: int) -> None:
    quats, log_scales = made(seed)
    found = covariances(quats, log_scales)
    np.testing.assert_array_equal(found, np.swapaxes(found, 1, 2))
    np.testing.assert_allclose(
        np.linalg.eigvalsh(found), np.sort(np.exp(2 * log_scales), axis=1), rtol=1e-6, atol=1e-12
    )


@given(seeds)
def test_variance_along_each_own_axis_is_its_squared_scale(seed: int) -> None:
    quats, log_scales = made(seed)
    axes = quats_to_rotations(quats)
    along = np.einsum("mia,mij,mja->ma", axes, covariances(quats, log_scales), axes)
    np.testing.assert_allclose(along, np.exp(2 * log_scales), rtol=1e-9)


def test_identity_rotation_is_diagonal() -> None:
    found = covariances(np.array([[2.0, 0, 0, 0]]), np.log(np.array([[1.0, 2.0, 3.0]])))
    np.testing.assert_allclose(found[0], np.diag([1, 4, 9]), atol=1e-12)


def test_flat_axis_gives_a_flat_covariance() -> None:
    found = covariances(np.array([[1.0, 0, 0, 0]]), np.array([[0.0, 0.0, -np.inf]]))
    np.testing.assert_allclose(found[0], np.diag([1, 1, 0]))


def test_samples_spread_as_the_covariance_says() -> None:
    quats, log_scales = made(3, count=1)
    rng, count = np.random.default_rng(0), 200_000
    samples = rng.normal(size=(count, 3)) * np.exp(log_scales[0]) @ quats_to_rotations(quats)[0].T
    found = covariances(quats, log_scales)[0]
    # The error of a sampled variance is about sqrt(2 / count) of the largest one; five times that never fails.
    assert np.cov(samples.T) == pytest.approx(found, abs=5 * np.sqrt(2 / count) * np.exp(2 * log_scales.max()))
