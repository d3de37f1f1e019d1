# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""What `prepare` computes once per scene, for parameters that change with every step: only the blocks a view may show.

Work is split over ranges of blocks of 128 Gaussians, in the order they are stored. Eight Gaussians go through every
instruction together, all in float32.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel
from pipeline.render.simd_kernels import (
    fma,
    gather,
    larger,
    minus_magnitude,
    power_of_two,
    select,
    smaller,
    splat,
    square_root,
    store,
    to_floats,
    truncate,
)

LOG2_E = np.float32(np.log2(np.e))
LOG2_E_REST = np.float32(np.log2(np.e) - np.float64(LOG2_E))
"""What float32 leaves of log2 e: with it the exponent's fraction is as fine as float32 gets, however large x is."""
LARGEST_LOG = np.float32(np.log(1e9))
"""Standard deviations are cut at 1e9 m, as in `prepare`."""
SMALLEST_LOG = np.float32(-87.0)
"""e to a lower power is taken as 0."""

# 2^x for x in [-1/2, 1/2]: Taylor's terms, ln(2)^k / k!, which leave 4e-9 there.
P1, P2, P3, P4, P5, P6, P7 = (
    np.float32(c)
    for c in (
        6.931471805599453e-01,
        2.402265069591007e-01,
        5.550410866482158e-02,
        9.618129107628477e-03,
        1.333355814642844e-03,
        1.540353039338161e-04,
        1.525273380405984e-05,
    )
)


@njit(error_model="numpy")
def exp_lanes(x):
    """Return e^x; 0 below e^-87. Lanes must not exceed 87."""
    zero, half = splat(np.float32(0.0)), splat(np.float32(0.5))
    kept = larger(x, splat(SMALLEST_LOG))
    y = kept * splat(LOG2_E)
    whole = truncate(y + select(y < zero, -half, half))
    f = fma(kept, splat(LOG2_E_REST), fma(kept, splat(LOG2_E), -to_floats(whole)))
    p = fma(f, splat(P7), splat(P6))
    p = fma(f, fma(f, fma(f, p, splat(P5)), splat(P4)), splat(P3))
    p = fma(f, fma(f, fma(f, p, splat(P2)), splat(P1)), splat(np.float32(1.0)))
    return select(x >= splat(SMALLEST_LOG), p * power_of_two(whole), zero)


@njit(error_model="numpy")
def log2_sigmoid_lanes(logits):
    """Return log2 of the opacities: min(y, 0) - log2(1 + 2^-|y|) with y in powers of two, by the series of artanh."""
    zero, two = splat(np.float32(0.0)), splat(np.float32(2.0))
    y = logits * splat(LOG2_E)
    e = exp_lanes(minus_magnitude(logits))
    s = e / (two + e)
    ss = s * s
    p = fma(ss, splat(np.float32(1 / 15)), splat(np.float32(1 / 13)))
    p = fma(ss, fma(ss, p, splat(np.float32(1 / 11))), splat(np.float32(1 / 9)))
    p = fma(ss, fma(ss, p, splat(np.float32(1 / 7))), splat(np.float32(1 / 5)))
    p = fma(ss, fma(ss, p, splat(np.float32(1 / 3))), splat(np.float32(1.0)))
    return smaller(y, zero) - s * p * splat(np.float32(2.0 / np.log(2.0)))


@njit(error_model="numpy")
def unit_quats(quats, places):
    """Return w, x, y, z of eight quaternions made unit, their norms, and which of them are not zero."""
    w, x, y, z = gather(quats, places, 0), gather(quats, places, 1), gather(quats, places, 2), gather(quats, places, 3)
    # Squares of the parts of the largest are at most 4, whatever the norm.
    most = -smaller(smaller(minus_magnitude(w), minus_magnitude(x)), smaller(minus_magnitude(y), minus_magnitude(z)))
    usable = most > splat(np.float32(0.0))
    most = select(usable, most, splat(np.float32(1.0)))
    w, x, y, z = w / most, x / most, y / most, z / most
    norm = square_root(fma(w, w, fma(x, x, fma(y, y, z * z))))
    inverse = splat(np.float32(1.0)) / select(usable, norm, splat(np.float32(1.0)))
    return w * inverse, x * inverse, y * inverse, z * inverse, norm * most, usable


@kernel
def bound_blocks(means, log_scales, first, last, centers, halves, reach):
    """Write the centre and half size of the box around the means of blocks first to last, and their largest deviation.

    Takes means (M * 3,) and log_scales (M * 3,) float32; writes centers and halves (B, 3), reach (B,) float64.
    """
    count = means.size // 3
    for block in range(first, last):
        end = min((block + 1) * 128, count)
        largest = np.float32(-np.inf)
        for axis in range(3):
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for k in range(block * 384 + axis, end * 3, 3):
                low, high = min(low, means[k]), max(high, means[k])
                largest = max(largest, log_scales[k])
            centers[block, axis] = (np.float64(low) + np.float64(high)) / 2
            halves[block, axis] = (np.float64(high) - np.float64(low)) / 2
        # A hair more than the deviation itself, which is rounded elsewhere.
        reach[block] = min(np.exp(np.float64(largest)), 1e9) * (1 + 1e-5)


@kernel
def activate(means, quats, log_scales, opacity_logits, blocks, first, last, geometry):
    """Write the means, scaled axes and log2 opacities of `blocks[first:last]` as `project` reads them.

    Takes flat float32 arrays of M Gaussians and writes geometry (blocks * 16 * 104,) float32; places beyond M, and
    Gaussians with a zero quaternion, get opacity 0.
    """
    count = opacity_logits.size
    at3, at4, at1 = np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8, np.int64)
    one, two = splat(np.float32(1.0)), splat(np.float32(2.0))
    largest, nothing = splat(LARGEST_LOG), splat(np.float32(-np.inf))
    for number in range(first, last):
        block = np.int64(blocks[number])
        for group in range(block * 16, block * 16 + 16):
            for lane in range(8):
                k = min(group * 8 + lane, count - 1)
                at1[lane], at3[lane], at4[lane] = k, 3 * k, 4 * k
            g = group * 104
            store(geometry, g, gather(means, at3, 0))
            store(geometry, g + 8, gather(means, at3, 1))
            store(geometry, g + 16, gather(means, at3, 2))
            w, x, y, z, _, usable = unit_quats(quats, at4)
            s0 = exp_lanes(smaller(gather(log_scales, at3, 0), largest))
            s1 = exp_lanes(smaller(gather(log_scales, at3, 1), largest))
            s2 = exp_lanes(smaller(gather(log_scales, at3, 2), largest))
            store(geometry, g + 24, s0 * fma(-two, fma(y, y, z * z), one))
            store(geometry, g + 32, s0 * (two * fma(x, y, w * z)))
            store(geometry, g + 40, s0 * (two * fma(x, z, -(w * y))))
            store(geometry, g + 48, s1 * (two * fma(x, y, -(w * z))))
            store(geometry, g + 56, s1 * fma(-two, fma(x, x, z * z), one))
            store(geometry, g + 64, s1 * (two * fma(y, z, w * x)))
            store(geometry, g + 72, s2 * (two * fma(x, z, w * y)))
            store(geometry, g + 80, s2 * (two * fma(y, z, -(w * x))))
            store(geometry, g + 88, s2 * fma(-two, fma(x, x, y * y), one))
            log2_opacity = log2_sigmoid_lanes(gather(opacity_logits, at1, 0))
            store(geometry, g + 96, select(usable, log2_opacity, nothing))
            for k in range(max(count, group * 8), group * 8 + 8):
                geometry[g + 96 + (k & 7)] = np.float32(-np.inf)
