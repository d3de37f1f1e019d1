# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Compiled L1 and SSIM with their gradient: Gaussian window of 11 pixels, zeros beyond the border, as 3DGS trains with.

An image is rows of 3 W numbers, so that a tap to the side is an offset of 3 and every inner loop runs over neighbours
in memory. Work is split into strips of rows; a strip blurs five more rows above and below it and keeps its sums to
itself, so that no number of threads changes a bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

RADIUS = 5
"""Pixels on each side of the window's centre."""
SIGMA = 1.5
"""Standard deviation of the window, pixels."""
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
"""Constants that keep SSIM finite, for images of 0 to 1 (Wang et al. 2004)."""
_TAPS = [math.exp(-0.5 * (k / SIGMA) ** 2) for k in range(RADIUS + 1)]
TAP0, TAP1, TAP2, TAP3, TAP4, TAP5 = (np.float32(tap / (2.0 * sum(_TAPS) - 1.0)) for tap in _TAPS)
PAD = 3 * RADIUS
"""Zeros on each side of a row."""


@njit
def _blur(rows, out, start, width, step):
    """Write out[j], the weighted sum of the 11 numbers of `rows` that lie `step` apart from start + j on.

    Unsigned, since an index that might be negative keeps the loop from being vectorised.
    """
    for j in range(np.uint64(width)):
        a = np.uint64(start) + j
        out[j] = (
            TAP5 * (rows[a] + rows[a + np.uint64(10 * step)])
            + TAP4 * (rows[a + np.uint64(step)] + rows[a + np.uint64(9 * step)])
            + TAP3 * (rows[a + np.uint64(2 * step)] + rows[a + np.uint64(8 * step)])
            + TAP2 * (rows[a + np.uint64(3 * step)] + rows[a + np.uint64(7 * step)])
            + TAP1 * (rows[a + np.uint64(4 * step)] + rows[a + np.uint64(6 * step)])
            + TAP0 * rows[a + np.uint64(5 * step)]
        )


@kernel
def ssim_forward(first, last, height, width, x, y, by_mean, by_square, by_product, sums, slot):
    """Write the derivatives of SSIM for rows first to last, and sums[slot]: the sums of |x - y| and of SSIM there.

    Takes x, y (height * width,) float32, width = 3 W numbers a row; writes by_mean, by_square, by_product
    (height * width,) float32: derivatives with respect to the blurred x, x * x and x * y.
    """
    tall = last - first + 2 * RADIUS
    rows = np.zeros((5, tall * width), np.float32)
    padded = np.zeros((5, width + 2 * PAD), np.float32)
    for k in range(tall):
        row = first - RADIUS + k
        if row < 0 or row >= height:
            continue
        for j in range(width):
            a, b = x[row * width + j], y[row * width + j]
            padded[0, PAD + j] = a
            padded[1, PAD + j] = b
            padded[2, PAD + j] = a * a
            padded[3, PAD + j] = b * b
            padded[4, PAD + j] = a * b
        for field in range(5):
            _blur(padded[field], rows[field, k * width : (k + 1) * width], 0, width, 3)
    blurred = np.empty((5, width), np.float32)
    two = np.float32(2.0)
    l1, similarity = 0.0, 0.0
    for row in range(first, last):
        for field in range(5):
            _blur(rows[field], blurred[field], (row - first) * width, width, width)
        for j in range(width):
            mu_x, mu_y = blurred[0, j], blurred[1, j]
            luminance = two * mu_x * mu_y + C1
            structure = two * (blurred[4, j] - mu_x * mu_y) + C2
            means = mu_x * mu_x + mu_y * mu_y + C1
            spreads = blurred[2, j] - mu_x * mu_x + blurred[3, j] - mu_y * mu_y + C2
            inverse = np.float32(1.0) / (means * spreads)
            ssim = luminance * structure * inverse
            at = row * width + j
            by_mean[at] = two * (mu_y * (structure - luminance) * inverse + ssim * mu_x * (means - spreads) * inverse)
            by_square[at] = -ssim * means * inverse
            by_product[at] = two * luminance * inverse
            blurred[0, j] = ssim
        for j in range(width):
            similarity += blurred[0, j]
            l1 += abs(x[row * width + j] - y[row * width + j])
    sums[slot, 0] = l1
    sums[slot, 1] = similarity


@kernel
def ssim_backward(first, last, height, width, x, y, by_mean, by_square, by_product, l1_scale, ssim_scale, gradient):
    """Write gradient (height * width,) float32 by x of l1_scale sum|x - y| + ssim_scale sum SSIM, in these rows."""
    tall = last - first + 2 * RADIUS
    rows = np.zeros((3, tall * width), np.float32)
    padded = np.zeros((3, width + 2 * PAD), np.float32)
    for k in range(tall):
        row = first - RADIUS + k
        if row < 0 or row >= height:
            continue
        for j in range(width):
            padded[0, PAD + j] = by_mean[row * width + j]
            padded[1, PAD + j] = by_square[row * width + j]
            padded[2, PAD + j] = by_product[row * width + j]
        for field in range(3):
            _blur(padded[field], rows[field, k * width : (k + 1) * width], 0, width, 3)
    blurred = np.empty((3, width), np.float32)
    for row in range(first, last):
        for field in range(3):
            _blur(rows[field], blurred[field], (row - first) * width, width, width)
        for j in range(width):
            at = row * width + j
            slope = blurred[0, j] + np.float32(2.0) * x[at] * blurred[1, j] + y[at] * blurred[2, j]
            gradient[at] = ssim_scale * slope + l1_scale * np.sign(x[at] - y[at])
