# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Colours of the records a view kept: spherical harmonics of degree 0 to 3 along the ray from the camera.

Work is split over ranges of the depth order. Coefficients are read from the scene's own array, for records that touch
an unfinished tile only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.cached_kernels import kernel
from pipeline.render.project_kernels import BLUE, GREEN, RECORD, RED
from pipeline.render.simd_kernels import prefetch

AHEAD = 8
"""Records between asking for a colour and reading it."""

C0 = np.float32(0.28209479177387814)
C1 = np.float32(0.4886025119029199)
C2 = tuple(
    np.float32(c)
    for c in (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
)
C3 = tuple(
    np.float32(c)
    for c in (
        -0.5900435899266435,
        2.890611442640554,
        -0.4570457994644658,
        0.3731763325901154,
        -0.4570457994644658,
        1.445305721320277,
        -0.5900435899266435,
    )
)


@njit(error_model="numpy")
def basis(degree, x, y, z, out):
    """Write the harmonics up to `degree` of a unit direction to `out` (16,)."""
    out[0] = C0
    if degree > 0:
        out[1], out[2], out[3] = -C1 * y, C1 * z, -C1 * x
    if degree > 1:
        xx, yy, zz = x * x, y * y, z * z
        out[4], out[5], out[7] = C2[0] * x * y, C2[1] * y * z, C2[3] * x * z
        out[6] = C2[2] * (np.float32(2.0) * zz - xx - yy)
        out[8] = C2[4] * (xx - yy)
        if degree > 2:
            out[9] = C3[0] * y * (np.float32(3.0) * xx - yy)
            out[10] = C3[1] * x * y * z
            out[11] = C3[2] * y * (np.float32(4.0) * zz - xx - yy)
            out[12] = C3[3] * z * (np.float32(2.0) * zz - np.float32(3.0) * xx - np.float32(3.0) * yy)
            out[13] = C3[4] * x * (np.float32(4.0) * zz - xx - yy)
            out[14] = C3[5] * z * (xx - yy)
            out[15] = C3[6] * x * (xx - np.float32(3.0) * yy)


@kernel
def shade(sh, coefficients, means, degree, center, ids, touched, count, records):
    """Write the colours of the records `touched[:count]`: max(0, sum + 0.5).

    Takes sh (M * coefficients * 3,) float32, means (M * 3,) float32 in metres, the degree to use (0 to 3, at most what
    `sh` holds), the camera centre (3,) float64 in metres, and ids (rows,) int32, the Gaussian of each record.
    """
    y = np.zeros(16, np.float32)
    used = (degree + 1) * (degree + 1)
    y[0] = C0
    for k in range(count):
        ahead = np.int64(ids[touched[min(k + AHEAD, count - 1)]])
        for line in range(ahead * coefficients * 3, (ahead * coefficients + used) * 3, 16):
            prefetch(sh, line)
        if degree > 0:
            prefetch(means, ahead * 3)
        record = touched[k]
        gaussian = np.int64(ids[record])
        if degree > 0:
            dx = means[gaussian * 3] - center[0]
            dy = means[gaussian * 3 + 1] - center[1]
            dz = means[gaussian * 3 + 2] - center[2]
            inverse = 1.0 / np.sqrt(dx * dx + dy * dy + dz * dz)
            basis(degree, np.float32(dx * inverse), np.float32(dy * inverse), np.float32(dz * inverse), y)
        red, green, blue = np.float32(0.5), np.float32(0.5), np.float32(0.5)
        at = gaussian * coefficients * 3
        for j in range(used):
            red += y[j] * sh[at]
            green += y[j] * sh[at + 1]
            blue += y[j] * sh[at + 2]
            at += 3
        r = record * RECORD
        records[r + RED] = max(red, np.float32(0.0))
        records[r + GREEN] = max(green, np.float32(0.0))
        records[r + BLUE] = max(blue, np.float32(0.0))
