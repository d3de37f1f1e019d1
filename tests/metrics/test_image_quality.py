"""PSNR, SSIM and depth errors against formulas written out pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.image_quality import depth_errors, psnr, ssim, ssim_map
from schemas.errors import InputError


def images(seed: int, height: int = 14, width: int = 17) -> tuple[np.ndarray, np.ndarray]:
    """Two related images with flat parts, where a variance is nearly 0."""
    rng = np.random.default_rng(seed)
    first = rng.random((height, width, 3))
    first[:, : width // 2] = 0.3
    return first, np.clip(first + rng.normal(0, 0.1, first.shape), 0, 1)


def ssim_by_pixel(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Wang et al. 2004, equation 13, window by window; outside the image everything is 0."""
    offsets = np.arange(-5, 6)
    window = np.exp(-(offsets[:, None] ** 2 + offsets[None, :] ** 2) / (2 * 1.5**2))
    window /= window.sum()
    out = np.zeros_like(x)
    for channel in range(3):
        a, b = np.pad(x[..., channel], 5), np.pad(y[..., channel], 5)
        for row in range(x.shape[0]):
            for column in range(x.shape[1]):
                p, q = a[row : row + 11, column : column + 11], b[row : row + 11, column : column + 11]
                mean_p, mean_q = (window * p).sum(), (window * q).sum()
                var_p, var_q = (window * (p - mean_p) ** 2).sum(), (window * (q - mean_q) ** 2).sum()
                both = (window * (p - mean_p) * (q - mean_q)).sum()
                out[row, column, channel] = ((2 * mean_p * mean_q + 1e-4) * (2 * both + 9e-4)) / (
                    (mean_p**2 + mean_q**2 + 1e-4) * (var_p + var_q + 9e-4)
                )
    return out


def test_ssim_map_equals_the_formula_window_by_window() -> None:
    first, second = images(0)
    np.testing.assert_allclose(ssim_map(first, second), ssim_by_pixel(first, second), atol=1e-12)


def test_ssim_of_an_image_smaller_than_the_window_is_defined() -> None:
    first, second = images(1, 4, 6)
    assert ssim(first, second) == pytest.approx(ssim_by_pixel(first, second).mean(), abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000))
def test_ssim_is_symmetric_and_one_only_for_equal_images(seed: int) -> None:
    first, second = images(seed, 12, 12)
    assert ssim(first, second) == pytest.approx(ssim(second, first), abs=1e-12)
    assert ssim(first, first) == pytest.approx(1.0, abs=1e-12)
    assert ssim(first, second) < 0.999


def test_psnr_of_a_constant_error_is_known() -> None:
    black = np.zeros((5, 6, 3), np.float32)
    assert psnr(black + np.float32(0.1), black) == pytest.approx(20.0, abs=1e-5)
    assert psnr(black, black) == np.inf


def test_psnr_takes_bytes_and_floats_alike() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, 256, (2, 8, 9, 3), dtype=np.uint8)
    assert psnr(first, second) == pytest.approx(psnr(first / 255.0, second), abs=1e-9)
    error = ((first.astype(float) - second) ** 2).mean()
    assert psnr(first, second) == pytest.approx(20 * np.log10(255 / np.sqrt(error)), abs=1e-9)


def test_psnr_cuts_what_a_screen_would_cut() -> None:
    white = np.ones((4, 4, 3))
    assert psnr(white * 3, white) == np.inf


def test_psnr_of_a_mask_counts_its_pixels_only() -> None:
    reference = np.zeros((4, 6, 3))
    image, left = reference.copy(), np.zeros((4, 6), bool)
    left[:, :3] = True
    image[:, 3:] = 1.0
    image[:, :3] = 0.01
    assert psnr(image, reference, left) == pytest.approx(40.0, abs=1e-6)
    assert psnr(image, reference, ~left) == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(psnr(image, reference, np.zeros((4, 6), bool)))


def test_sizes_that_differ_are_refused() -> None:
    with pytest.raises(InputError, match="size"):
        psnr(np.zeros((4, 4, 3)), np.zeros((4, 5, 3)))
    with pytest.raises(InputError, match="size"):
        depth_errors(np.zeros((4, 4)), np.zeros((4, 5)))


def test_depth_errors_count_only_pixels_with_both_depths() -> None:
    measured = np.array([[2.0, 2.0, 2.0, 2.0, 0.0]])
    depth = np.array([[2.0, 2.04, 1.0, 0.0, 5.0]])
    found = depth_errors(depth, measured)
    assert found.compared == 3
    assert found.covered == pytest.approx(0.75)
    assert found.mean_abs_m == pytest.approx(1.04 / 3)
    assert found.median_abs_m == pytest.approx(0.04)
    assert found.mean_relative == pytest.approx(0.52 / 3)
    assert found.rmse_m == pytest.approx(np.sqrt((0.04**2 + 1.0) / 3))
    assert found.within_5cm == pytest.approx(2 / 3)


def test_depth_errors_without_a_pixel_to_compare_are_no_number() -> None:
    found = depth_errors(np.zeros((2, 2)), np.ones((2, 2)))
    assert found.compared == 0
    assert found.covered == 0.0
    assert np.isnan(found.mean_abs_m)
    assert np.isnan(depth_errors(np.ones((2, 2)), np.zeros((2, 2))).covered)
