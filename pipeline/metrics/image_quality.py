"""How near an image is to a photograph (PSNR, SSIM) and a depth image to a measured one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from schemas.errors import InputError

SSIM_WINDOW = 11
"""Width of the window, pixels (Wang et al. 2004)."""
SSIM_SIGMA = 1.5
"""Standard deviation of its Gaussian weights, pixels."""
SSIM_K1, SSIM_K2 = 0.01, 0.03
"""Shares of the peak, squared, that keep the ratios finite."""
CLOSE_M = 0.05
"""Depth this near counts as right: twice what a structured-light camera gets wrong at 3 m."""

Image = Float[np.ndarray, "H W 3"] | UInt8[np.ndarray, "H W 3"]
"""RGB: 0 to 1 as floats, which are cut to that range, or 0 to 255 as bytes."""
Reference = Float[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w 3"]
"""As `Image`; its size is compared at run time, with an error that says what came."""


@dataclass(frozen=True, slots=True)
class DepthErrors:
    """A rendered depth image against a measured one, over the pixels that have both."""

    compared: int
    """Pixels with both depths."""
    covered: float
    """Their share in the measured pixels, 0 to 1; NaN where nothing was measured."""
    mean_abs_m: float
    """Mean |difference|, metres; NaN without a pixel to compare, as all below."""
    median_abs_m: float
    """Median |difference|, metres."""
    mean_relative: float
    """Mean |difference| / measured depth."""
    rmse_m: float
    """Root mean square difference, metres."""
    within_5cm: float
    """Share of the compared pixels that are within `CLOSE_M`, 0 to 1."""


def psnr(image: Image, reference: Reference, mask: Bool[np.ndarray, "H W"] | None = None) -> float:
    """Return the peak signal-to-noise ratio in dB, over all pixels and channels; infinite for equal images.

    Args:
        image: What is judged.
        reference: What it should be, of the same size.
        mask: Pixels that count; None for all. NaN where none does.

    Raises:
        InputError: The sizes differ.
    """
    difference = _unit(image) - _unit(_same_size(image, reference))
    squares = difference**2 if mask is None else difference[mask] ** 2
    if not squares.size:
        return float("nan")
    error = float(squares.mean())
    return float("inf") if error == 0 else -10.0 * float(np.log10(error))


def ssim(image: Image, reference: Reference) -> float:
    """Return the mean structural similarity over pixels and channels, at most 1, as 3DGS computes it.

    Wang et al. 2004 with an 11 x 11 Gaussian window of sigma 1.5 and uncorrected (co)variances. The image is
    surrounded by zeros, as in 3DGS; the original drops the border instead, which differs in the third decimal.

    Args:
        image: What is judged.
        reference: What it should be, of the same size.

    Raises:
        InputError: The sizes differ.
    """
    return float(ssim_map(image, reference).mean())


def ssim_map(image: Image, reference: Reference) -> Float[np.ndarray, "H W 3"]:
    """Return the structural similarity at each pixel and channel; arguments are those of `ssim`."""
    from scipy.ndimage import correlate1d

    x, y = _unit(image), _unit(_same_size(image, reference))
    offsets = np.arange(SSIM_WINDOW) - SSIM_WINDOW // 2
    weights = np.exp(-(offsets**2) / (2 * SSIM_SIGMA**2))
    weights /= weights.sum()

    def local_mean(values: Float[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W 3"]:
        return correlate1d(correlate1d(values, weights, 0, mode="constant"), weights, 1, mode="constant")

    mean_x, mean_y = local_mean(x), local_mean(y)
    variance_x, variance_y = local_mean(x * x) - mean_x**2, local_mean(y * y) - mean_y**2
    covariance = local_mean(x * y) - mean_x * mean_y
    c1, c2 = SSIM_K1**2, SSIM_K2**2
    return ((2 * mean_x * mean_y + c1) * (2 * covariance + c2)) / (
        (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
    )


def depth_errors(depth_m: Float[np.ndarray, "H W"], measured_m: Float[np.ndarray, "h w"]) -> DepthErrors:
    """Return how far rendered z-depth is from measured z-depth; 0 means no depth in either.

    Args:
        depth_m: Rendered depth, metres.
        measured_m: Measured depth of the same camera, metres.

    Raises:
        InputError: The sizes differ.
    """
    if depth_m.shape != measured_m.shape:
        raise InputError("depth", field="size", expected=str(measured_m.shape), found=depth_m.shape)
    measured = measured_m > 0
    both = measured & (depth_m > 0)
    compared, total = int(both.sum()), int(measured.sum())
    covered = compared / total if total else float("nan")
    if not compared:
        return DepthErrors(0, covered, *[float("nan")] * 5)
    truth = measured_m[both].astype(np.float64)
    error = np.abs(depth_m[both] - truth)
    return DepthErrors(
        compared=compared,
        covered=covered,
        mean_abs_m=float(error.mean()),
        median_abs_m=float(np.median(error)),
        mean_relative=float((error / truth).mean()),
        rmse_m=float(np.sqrt((error**2).mean())),
        within_5cm=float((error <= CLOSE_M).mean()),
    )


def _unit(image: Image) -> Float[np.ndarray, "H W 3"]:
    if image.dtype == np.uint8:
        return image.astype(np.float64) / 255.0
    return np.clip(image.astype(np.float64), 0.0, 1.0)


def _same_size(image: Image, reference: Reference) -> Image:
    if image.shape != reference.shape:
        raise InputError("image", field="size", expected=str(reference.shape), found=image.shape)
    return reference
