# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Projection: eight Gaussians at a time, survivors appended to a table of 64-byte records.

Work is split over ranges of the view's visible blocks; every range writes its own stretch of the table.

Only the camera transform runs in float64 (centre subtracted first, so world offsets cost nothing, and depths round to
the same float32 the reference sorts by). With p, q the image-axis rows of J V R S, the 2D covariance is
[[pp + .3, pq], [pq, qq + .3]]; its inverse is kept as two squares,
    q(dx, dy) = (dx + s dy)^2 / D + dy^2 / c,   c = qq + .3,  s = -pq / c,
    D = det / c = .3 + .3 pp / c + |p x q|^2 / c,
so nothing cancels for needles, and the exponent can never come out positive. All of it is scaled so that
alpha = 2^(log2 opacity - m^2 - n^2) with m = mu dx + mv dy, n = nv dy.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel
from pipeline.render.simd_kernels import (
    bits,
    float_bits,
    fma,
    larger,
    load,
    lowest_bit,
    narrow,
    smaller,
    splat,
    square_root,
    store,
    truncate,
    widen,
)

# Offsets in a record. The first vector of eight and the second's first two numbers are what compositing copies.
U, V, MU, MV, NV, LOG2_OPACITY, DEPTH, RED, GREEN, BLUE, SLOPE, INVERSE_MU, EXTREME, BOUND = range(14)
RECORD = 16

TILE_SHIFT = 4
"""Tiles are 16 x 16 pixels."""
SLACK = np.float32(1e-3)
"""Pixels added to every span for rounding; too large costs time only, alpha is tested again per pixel."""
LOW_PASS = np.float32(0.3)
"""Variance added to both image axes, px^2: a Gaussian covers about a pixel at least."""
SCALE = np.float32(np.sqrt(0.5 * np.log2(np.e)))
"""exp(-q/2) = 2^-(SCALE^2 q)."""
ANTIALIAS_FLOOR = np.float32(2.5e-5)
"""Smallest ratio of determinants the antialias option reckons with, as in the reference rasteriser."""


@njit(error_model="numpy")
def tiles_in(edges):
    """Return the columns and rows of tiles between edges left, top, right, bottom (see `Window`)."""
    return (edges[2] - edges[0] + 15) >> TILE_SHIFT, (edges[3] - edges[1] + 15) >> TILE_SHIFT


@kernel
def project(
    geometry, gaussian_ids, blocks, first, last, lens, limits, edges, antialias,
    records, rectangles, ids, keys, at,
):  # fmt: skip
    """Append the survivors of `blocks[first:last]` from row `at`; return the row after them.

    Takes geometry (P * 13,) float32 in groups of eight, gaussian_ids (P,) int32, blocks (b,) int32 of 16 groups each,
    lens (21,) float64 (see `Lens.packed`), limits (2,) float32 (see `RenderQuality.limits`) and the window's edges (see
    `Window`): what does not reach it is dropped, and rectangles are cut to it. Writes records (rows * 16,) float32,
    rectangles (rows * 2,) int32, first and last tile column, then row, in 16 bits each, ids (rows,) int32 and keys
    (rows,) uint64, depth bits over row number.
    """
    r00, r01, r02 = splat(lens[0]), splat(lens[1]), splat(lens[2])
    r10, r11, r12 = splat(lens[3]), splat(lens[4]), splat(lens[5])
    r20, r21, r22 = splat(lens[6]), splat(lens[7]), splat(lens[8])
    s00, s01, s02 = narrow(r00), narrow(r01), narrow(r02)
    s10, s11, s12 = narrow(r10), narrow(r11), narrow(r12)
    s20, s21, s22 = narrow(r20), narrow(r21), narrow(r22)
    center_x, center_y, center_z = splat(lens[9]), splat(lens[10]), splat(lens[11])
    focal_x, focal_y, principal_x, principal_y = splat(lens[12]), splat(lens[13]), splat(lens[14]), splat(lens[15])
    x_low, x_high = splat(np.float32(lens[16])), splat(np.float32(lens[17]))
    y_low, y_high = splat(np.float32(lens[18])), splat(np.float32(lens[19]))
    near = splat(np.float32(lens[20]))
    zero, one, low_pass = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(LOW_PASS)
    scale, inverse_scale = splat(SCALE), splat(np.float32(1.0) / SCALE)
    log2_alpha_min, least_bound = splat(limits[0]), splat(limits[1])
    left, top = splat(np.float32(edges[0])), splat(np.float32(edges[1]))
    last_x, last_y = splat(np.float32(edges[2] - 1)), splat(np.float32(edges[3] - 1))
    to_first, to_last = splat(np.float32(0.5) - SLACK), splat(SLACK - np.float32(0.5))
    shift, halfword = splat(np.int32(TILE_SHIFT)), splat(np.int32(16))
    lanes, places = np.empty(RECORD * 8, np.float32), np.empty(16, np.int32)
    for number in range(first, last):
        block = np.int64(blocks[number])
        for group in range(block * 16, block * 16 + 16):
            g = group * 104
            bound = load(geometry, g + 96) - log2_alpha_min
            x = widen(load(geometry, g)) - center_x
            y = widen(load(geometry, g + 8)) - center_y
            z = widen(load(geometry, g + 16)) - center_z
            camera_z = fma(r20, x, fma(r21, y, r22 * z))
            depth = narrow(camera_z)
            seen = (depth > near) & (bound >= least_bound)
            if bits(seen) == 0:
                continue
            over_z = splat(1.0) / camera_z
            tan_x = fma(r00, x, fma(r01, y, r02 * z)) * over_z
            tan_y = fma(r10, x, fma(r11, y, r12 * z)) * over_z
            u = narrow(fma(focal_x, tan_x, principal_x))
            v = narrow(fma(focal_y, tan_y, principal_y))
            gain_x, gain_y = narrow(focal_x * over_z), narrow(focal_y * over_z)
            side_x = smaller(larger(narrow(tan_x), x_low), x_high)
            side_y = smaller(larger(narrow(tan_y), y_low), y_high)
            # Rows of J V, then of J V R S, one column of R S at a time.
            a0 = gain_x * fma(-side_x, s20, s00)
            a1 = gain_x * fma(-side_x, s21, s01)
            a2 = gain_x * fma(-side_x, s22, s02)
            b0 = gain_y * fma(-side_y, s20, s10)
            b1 = gain_y * fma(-side_y, s21, s11)
            b2 = gain_y * fma(-side_y, s22, s12)
            c0, c1, c2 = load(geometry, g + 24), load(geometry, g + 32), load(geometry, g + 40)
            p0, q0 = fma(a0, c0, fma(a1, c1, a2 * c2)), fma(b0, c0, fma(b1, c1, b2 * c2))
            c0, c1, c2 = load(geometry, g + 48), load(geometry, g + 56), load(geometry, g + 64)
            p1, q1 = fma(a0, c0, fma(a1, c1, a2 * c2)), fma(b0, c0, fma(b1, c1, b2 * c2))
            c0, c1, c2 = load(geometry, g + 72), load(geometry, g + 80), load(geometry, g + 88)
            p2, q2 = fma(a0, c0, fma(a1, c1, a2 * c2)), fma(b0, c0, fma(b1, c1, b2 * c2))
            pp = fma(p0, p0, fma(p1, p1, p2 * p2))
            c = fma(q0, q0, fma(q1, q1, fma(q2, q2, low_pass)))
            root = one / square_root(c)
            q0, q1, q2 = q0 * root, q1 * root, q2 * root
            m0, m1, m2 = fma(p0, q1, -(p1 * q0)), fma(p0, q2, -(p2 * q0)), fma(p1, q2, -(p2 * q1))
            minors = fma(m0, m0, fma(m1, m1, m2 * m2))
            d = minors + fma(low_pass * root, root * pp, low_pass)
            slope = -(fma(p0, q0, fma(p1, q1, p2 * q2)) * root)
            if antialias:
                store(lanes, 0, minors / d)
                for lane in range(8):
                    lanes[lane] = np.float32(0.5) * np.log2(max(lanes[lane], ANTIALIAS_FLOOR))
                bound = bound + load(lanes, 0)
                seen = seen & (bound >= zero)
            half_width = square_root(bound * (pp + low_pass)) * inverse_scale
            half_height = square_root(bound * c) * inverse_scale
            # First pixel centre inside (a ceiling) and last one (a floor), by truncation of numbers above zero.
            x_end, y_end = u + half_width + to_last, v + half_height + to_last
            x_first = truncate(smaller(larger(u - half_width + to_first, left), last_x + one))
            y_first = truncate(smaller(larger(v - half_height + to_first, top), last_y + one))
            x_last = truncate(smaller(larger(x_end, left), last_x))
            y_last = truncate(smaller(larger(y_end, top), last_y))
            seen = seen & (x_end >= left) & (y_end >= top) & (x_first <= x_last) & (y_first <= y_last)
            mask = bits(seen)
            if mask == 0:
                continue
            inverse_mu = square_root(d) * inverse_scale
            mu = one / inverse_mu
            store(lanes, U * 8, u)
            store(lanes, V * 8, v)
            store(lanes, MU * 8, mu)
            store(lanes, MV * 8, mu * slope)
            store(lanes, NV * 8, root * scale)
            store(lanes, LOG2_OPACITY * 8, bound + log2_alpha_min)
            store(lanes, DEPTH * 8, depth)
            store(lanes, SLOPE * 8, slope)
            store(lanes, INVERSE_MU * 8, inverse_mu)
            store(lanes, EXTREME * 8, -slope * half_height * half_height / half_width)
            store(lanes, BOUND * 8, bound)
            store(places, 0, (x_first >> shift) | ((x_last >> shift) << halfword))
            store(places, 8, (y_first >> shift) | ((y_last >> shift) << halfword))
            while mask != 0:
                lane = lowest_bit(mask)
                mask &= mask - np.uint32(1)
                row = at * RECORD
                for field in range(14):
                    records[row + field] = lanes[field * 8 + lane]
                rectangles[2 * at], rectangles[2 * at + 1] = places[lane], places[8 + lane]
                ids[at] = gaussian_ids[group * 8 + lane]
                keys[at] = (np.uint64(float_bits(lanes[DEPTH * 8 + lane])) << np.uint64(32)) | np.uint64(at)
                at += 1
    return at
