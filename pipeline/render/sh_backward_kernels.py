# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""From the gradient of a colour back to its spherical harmonics and to the direction it is seen from, in eight lanes.

A harmonic is a polynomial of the direction; its derivatives are those of the form `write_basis` evaluates, which the
caller makes tangent to the sphere.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.sh_kernels import C0, C1, C20, C22, C24, C30, C31, C32, C33, C35
from pipeline.render.simd_kernels import at, fma, load, put, splat, store
from pipeline.render.transpose_kernels import transposed

TWO, THREE, FOUR, SIX, EIGHT = (np.float32(k) for k in (2, 3, 4, 6, 8))


@njit(error_model="numpy")
def pull_back_coefficients(used, basis, red, green, blue, pulled):
    """Write the gradients of the first `used` coefficients of eight Gaussians, coefficient before channel."""
    for k in range(used):
        b = splat(C0) if k == 0 else load(basis, k * 8)
        store(pulled, k * 24, b * red)
        store(pulled, k * 24 + 8, b * green)
        store(pulled, k * 24 + 16, b * blue)


@njit(error_model="numpy")
def write_coefficients(pulled, count, first, rows, d_sh):
    """Write the `count` numbers of each of eight Gaussians to `rows` rows of d_sh, `count` long, from `first` on."""
    whole = count & ~7
    for k in range(0, whole, 8):
        columns = transposed(
            load(pulled, k * 8), load(pulled, k * 8 + 8), load(pulled, k * 8 + 16), load(pulled, k * 8 + 24),
            load(pulled, k * 8 + 32), load(pulled, k * 8 + 40), load(pulled, k * 8 + 48), load(pulled, k * 8 + 56),
        )  # fmt: skip
        for lane in range(rows):
            store(d_sh, (first + lane) * count + k, columns[lane])
    for lane in range(rows):
        for k in range(whole, count):
            put(d_sh, (first + lane) * count + k, at(pulled, k * 8 + lane))


@njit(error_model="numpy")
def pull_back_direction(degree, x, y, z, numbers, red, green, blue, slopes):
    """Return the gradient of eight directions, from those of their colours and their coefficients `numbers`.

    `slopes` is room for 16 vectors: how each harmonic pulls at the loss.
    """
    zero = splat(np.float32(0.0))
    for k in range(1, (degree + 1) * (degree + 1)):
        c = k * 24
        store(
            slopes, k * 8,
            fma(load(numbers, c), red, fma(load(numbers, c + 8), green, load(numbers, c + 16) * blue)),
        )  # fmt: skip
    dx, dy, dz = zero, zero, zero
    if degree < 1:
        return dx, dy, dz
    c1 = splat(C1)
    dx, dy, dz = -c1 * load(slopes, 24), -c1 * load(slopes, 8), c1 * load(slopes, 16)
    if degree < 2:
        return dx, dy, dz
    s4, s5, s7 = splat(C20) * load(slopes, 32), splat(C20) * load(slopes, 40), splat(C20) * load(slopes, 56)
    s6, s8 = splat(TWO * C22) * load(slopes, 48), splat(TWO * C24) * load(slopes, 64)
    dx = dx + y * s4 - z * s7 + x * (s8 - s6)
    dy = dy + x * s4 - z * s5 - y * (s8 + s6)
    dz = dz - y * s5 - x * s7 + splat(TWO) * z * s6
    if degree < 3:
        return dx, dy, dz
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    s9, s15 = splat(C30) * load(slopes, 72), splat(C30) * load(slopes, 120)
    s10, s14 = splat(C31) * load(slopes, 80), splat(C35) * load(slopes, 112)
    s11, s13, s12 = splat(C32) * load(slopes, 88), splat(C32) * load(slopes, 104), splat(C33) * load(slopes, 96)
    two, three, four, six, eight = splat(TWO), splat(THREE), splat(FOUR), splat(SIX), splat(EIGHT)
    difference = three * (xx - yy)
    dx = (
        dx - six * xy * s9 + yz * s10 + two * xy * s11 - six * xz * s12
        - (four * zz - three * xx - yy) * s13 + two * xz * s14 - difference * s15
    )  # fmt: skip
    dy = (
        dy - difference * s9 + xz * s10 - (four * zz - xx - three * yy) * s11 - six * yz * s12
        + two * xy * s13 - two * yz * s14 + six * xy * s15
    )  # fmt: skip
    dz = (
        dz + xy * s10 - eight * yz * s11 + three * (two * zz - xx - yy) * s12
        - eight * xz * s13 + (xx - yy) * s14
    )  # fmt: skip
    return dx, dy, dz
