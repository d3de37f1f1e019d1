# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Colours of the records a view kept: spherical harmonics of degree 0 to 3 along the ray from the camera.

Work is split over ranges of the depth order; eight records go through every instruction together. Coefficients are
read from the scene's own array, for records that touch an unfinished tile only. A record's direction follows from its
pixel, so means are not read again.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel
from pipeline.render.project_kernels import BLUE, GREEN, RECORD, RED, U, V
from pipeline.render.simd_kernels import (
    at,
    fma,
    gather,
    larger,
    load,
    narrow,
    prefetch,
    smaller,
    splat,
    square_root,
    store,
)
from pipeline.render.transpose_kernels import transposed

AHEAD = 16
"""Records between asking for a colour and reading it: two groups of eight."""
STEEPEST = np.float32(1e15)
"""Directions are cut at this tangent: their squares stay within float32, and they are sideways all the same."""

C0 = np.float32(0.28209479177387814)
C1 = np.float32(0.4886025119029199)
C20, C22, C24 = np.float32(1.0925484305920792), np.float32(0.31539156525252005), np.float32(0.5462742152960396)
C30, C31, C32 = np.float32(0.5900435899266435), np.float32(2.890611442640554), np.float32(0.4570457994644658)
C33, C35 = np.float32(0.3731763325901154), np.float32(1.445305721320277)


@njit(error_model="numpy")
def write_basis(degree, x, y, z, basis):
    """Write the harmonics 1 to (degree + 1)^2 - 1 of eight unit directions, eight lanes each."""
    if degree < 1:
        return
    store(basis, 8, splat(-C1) * y)
    store(basis, 16, splat(C1) * z)
    store(basis, 24, splat(-C1) * x)
    if degree < 2:
        return
    xx, yy, zz = x * x, y * y, z * z
    difference, both = xx - yy, xx + yy
    store(basis, 32, splat(C20) * (x * y))
    store(basis, 40, splat(-C20) * (y * z))
    store(basis, 48, splat(C22) * (zz + zz - both))
    store(basis, 56, splat(-C20) * (x * z))
    store(basis, 64, splat(C24) * difference)
    if degree < 3:
        return
    two, three, four = splat(np.float32(2.0)), splat(np.float32(3.0)), splat(np.float32(4.0))
    store(basis, 72, splat(-C30) * y * (three * xx - yy))
    store(basis, 80, splat(C31) * (x * y) * z)
    store(basis, 88, splat(-C32) * y * (four * zz - both))
    store(basis, 96, splat(C33) * z * (two * zz - three * both))
    store(basis, 104, splat(-C32) * x * (four * zz - both))
    store(basis, 112, splat(C35) * z * difference)
    store(basis, 120, splat(-C30) * x * (xx - three * yy))


@njit(error_model="numpy")
def read_coefficients(sh, places, count, coefficients):
    """Copy `count` numbers from each of eight `places` of `sh`, so that the eight of a kind lie side by side."""
    whole = count & ~7
    for k in range(0, whole, 8):
        rows = transposed(
            load(sh, places[0] + k), load(sh, places[1] + k), load(sh, places[2] + k), load(sh, places[3] + k),
            load(sh, places[4] + k), load(sh, places[5] + k), load(sh, places[6] + k), load(sh, places[7] + k),
        )  # fmt: skip
        for j in range(8):
            store(coefficients, (k + j) * 8, rows[j])
    for k in range(whole, count):
        store(coefficients, k * 8, gather(sh, places, k))


@kernel
def shade(sh, coefficients, degree, lens, ids, touched, count, records):
    """Write the colours of the records `touched[:count]`: max(0, sum + 0.5).

    Takes sh (M * coefficients * 3,) float32, the degree to use (0 to 3, at most what `sh` holds), lens (21,) float64
    (see `Lens.packed`) and ids (rows,) int32, the Gaussian of each record.
    """
    used = (degree + 1) * (degree + 1)
    basis = np.empty(16 * 8, np.float32)
    numbers, colors = np.empty(16 * 3 * 8, np.float32), np.empty(3 * 8, np.float32)
    places, rows = np.empty(8, np.int64), np.empty(8, np.int64)
    r00, r01, r02 = narrow(splat(lens[0])), narrow(splat(lens[1])), narrow(splat(lens[2]))
    r10, r11, r12 = narrow(splat(lens[3])), narrow(splat(lens[4])), narrow(splat(lens[5]))
    r20, r21, r22 = narrow(splat(lens[6])), narrow(splat(lens[7])), narrow(splat(lens[8]))
    over_fx, over_fy = splat(np.float32(1.0 / lens[12])), splat(np.float32(1.0 / lens[13]))
    cx, cy = splat(np.float32(lens[14])), splat(np.float32(lens[15]))
    zero, one, half = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(np.float32(0.5))
    steepest = splat(STEEPEST)
    for start in range(0, count, 8):
        for lane in range(8):
            record = np.int64(at(touched, min(start + lane + AHEAD, count - 1)))
            prefetch(records, record * RECORD)
            ahead = np.int64(at(ids, record)) * coefficients * 3
            for line in range(ahead, ahead + used * 3, 16):
                prefetch(sh, line)
            prefetch(sh, ahead + used * 3 - 1)
            prefetch(ids, np.int64(at(touched, min(start + lane + 2 * AHEAD, count - 1))))
            record = np.int64(touched[min(start + lane, count - 1)])
            rows[lane] = record * RECORD
            places[lane] = np.int64(ids[record]) * coefficients * 3
        read_coefficients(sh, places, used * 3, numbers)
        red = fma(splat(C0), load(numbers, 0), half)
        green = fma(splat(C0), load(numbers, 8), half)
        blue = fma(splat(C0), load(numbers, 16), half)
        if degree > 0:
            # Back from the pixel to a ray in camera axes (z = 1), then to a unit direction in the world.
            u = smaller(larger((gather(records, rows, U) - cx) * over_fx, -steepest), steepest)
            v = smaller(larger((gather(records, rows, V) - cy) * over_fy, -steepest), steepest)
            inverse = one / square_root(fma(u, u, fma(v, v, one)))
            x = fma(r00, u, fma(r10, v, r20)) * inverse
            y = fma(r01, u, fma(r11, v, r21)) * inverse
            z = fma(r02, u, fma(r12, v, r22)) * inverse
            write_basis(degree, x, y, z, basis)
            for k in range(1, used):
                b = load(basis, k * 8)
                red = fma(b, load(numbers, k * 24), red)
                green = fma(b, load(numbers, k * 24 + 8), green)
                blue = fma(b, load(numbers, k * 24 + 16), blue)
        store(colors, 0, larger(red, zero))
        store(colors, 8, larger(green, zero))
        store(colors, 16, larger(blue, zero))
        for lane in range(min(8, count - start)):
            row = rows[lane]
            records[row + RED] = at(colors, lane)
            records[row + GREEN] = at(colors, lane + 8)
            records[row + BLUE] = at(colors, lane + 16)
