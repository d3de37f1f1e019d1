# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""From a record's sums over its pixels back to the raw parameters of its Gaussian.

Work is split over ranges of the Gaussians seen, eight of which go through every instruction together; each writes its
own rows. With P the 2 x 3 matrix J V R S of rows p and q, and y = Sigma^-1 (pixel - centre), a Gaussian's exponent
-|L (pixel - centre)|^2 pulls with h y at the centre and with h y y^T / 2 at the covariance P P^T + 0.3, so
    dp = Yxx p + Yxy q,   dq = Yxy p + Yyy q,   Y = sum of h y y^T,
without a matrix ever being inverted here. From there
    d log scale_k = dp_k p_k + dq_k q_k,   d axis_k = dp_k a + dq_k b   (a, b the rows of J V),
and a rotation by the small vector w moves axis_k by w x axis_k: its torque is t = sum of axis_k x d axis_k, and the
gradient of the quaternion 2 (0, t) q / |q|^2, which is at a right angle to q.

The Jacobian is that of the clamped direction: beyond the clamp it no longer turns with x / z, as it still shrinks
with 1 / z. The centre is subtracted first, in float64, as in `project`.
"""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel
from pipeline.render.activate_backward_kernels import exp_lanes, unit_quats
from pipeline.render.blend_backward_kernels import HM, HMM, HMN, HN, HNN, SUMS, B, G, H, R, Z
from pipeline.render.project_kernels import BLUE, GREEN, LOG2_OPACITY, MU, MV, NV, RECORD, RED
from pipeline.render.sh_backward_kernels import pull_back_coefficients, pull_back_direction, write_coefficients
from pipeline.render.sh_kernels import read_coefficients, write_basis
from pipeline.render.simd_kernels import (
    at,
    fma,
    gather,
    larger,
    load,
    narrow,
    put,
    select,
    smaller,
    splat,
    square_root,
    store,
    widen,
)

LN_2 = np.float32(np.log(2.0))
TWO_LN_2 = np.float32(2.0 * np.log(2.0))
"""1 / SCALE^2 of project_kernels."""


@kernel
def pull_back(
    first, last, rows, bases, sums, records, ids, geometry, quats, sh, coefficients, degree, lens, half_size,
    d_means, d_quats, d_log_scales, d_opacity_logits, d_sh, norms,
):  # fmt: skip
    """Write the gradients of the Gaussians first to last of those seen.

    Takes rows (n,) int64 in the table of records, bases (n + 1,) int64, where the rows of `sums` of each begin, sums
    (k * 16,) float32, geometry as `activate` wrote it, quats (M * 4,), sh (M * coefficients * 3,), the degree in use,
    lens (21,) float64, half_size (2,) float32, half the image's width and height. Writes flat float32 arrays of n rows;
    those of d_sh hold the coefficients of the degree in use.
    """
    used = (degree + 1) * (degree + 1)
    basis, slopes = np.empty(16 * 8, np.float32), np.empty(16 * 8, np.float32)
    numbers, pulled = np.empty(16 * 3 * 8, np.float32), np.empty(16 * 3 * 8, np.float32)
    total, out = np.empty(8 * SUMS, np.float32), np.empty(12 * 8, np.float32)
    at_row, at_axes, at_quat, at_sh = (
        np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8, np.int64)
    )  # fmt: skip
    at_total = np.arange(8) * SUMS
    r00, r01, r02 = splat(lens[0]), splat(lens[1]), splat(lens[2])
    r10, r11, r12 = splat(lens[3]), splat(lens[4]), splat(lens[5])
    r20, r21, r22 = splat(lens[6]), splat(lens[7]), splat(lens[8])
    s00, s01, s02 = narrow(r00), narrow(r01), narrow(r02)
    s10, s11, s12 = narrow(r10), narrow(r11), narrow(r12)
    s20, s21, s22 = narrow(r20), narrow(r21), narrow(r22)
    center_x, center_y, center_z = splat(lens[9]), splat(lens[10]), splat(lens[11])
    focal_x, focal_y = splat(np.float32(lens[12])), splat(np.float32(lens[13]))
    x_low, x_high = splat(np.float32(lens[16])), splat(np.float32(lens[17]))
    y_low, y_high = splat(np.float32(lens[18])), splat(np.float32(lens[19]))
    zero, one, two = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(np.float32(2.0))
    for start in range(first, last, 8):
        count = min(8, last - start)
        for lane in range(8):
            k = min(start + lane, last - 1)
            row = rows[k]
            gaussian = np.int64(ids[row])
            at_row[lane], at_quat[lane] = row * RECORD, gaussian * 4
            at_axes[lane] = (gaussian >> 3) * 104 + (gaussian & 7)
            at_sh[lane] = gaussian * coefficients * 3
            low, high = splat(np.float32(0.0)), splat(np.float32(0.0))
            for s in range(bases[k] * SUMS, bases[k + 1] * SUMS, SUMS):
                low, high = low + load(sums, s), high + load(sums, s + 8)
            store(total, lane * SUMS, low)
            store(total, lane * SUMS + 8, high)

        # The camera's view of the mean, and the rows of J V.
        px = narrow(widen(gather(geometry, at_axes, 0)) - center_x)
        py = narrow(widen(gather(geometry, at_axes, 8)) - center_y)
        pz = narrow(widen(gather(geometry, at_axes, 16)) - center_z)
        over_z = one / fma(s20, px, fma(s21, py, s22 * pz))
        tan_x = fma(s00, px, fma(s01, py, s02 * pz)) * over_z
        tan_y = fma(s10, px, fma(s11, py, s12 * pz)) * over_z
        side_x, side_y = smaller(larger(tan_x, x_low), x_high), smaller(larger(tan_y, y_low), y_high)
        gain_x, gain_y = focal_x * over_z, focal_y * over_z
        a0, a1, a2 = gain_x * fma(-side_x, s20, s00), gain_x * fma(-side_x, s21, s01), gain_x * fma(-side_x, s22, s02)
        b0, b1, b2 = gain_y * fma(-side_y, s20, s10), gain_y * fma(-side_y, s21, s11), gain_y * fma(-side_y, s22, s12)

        # Pulls at the projected centre and at the covariance.
        mu, mv, nv = gather(records, at_row, MU), gather(records, at_row, MV), gather(records, at_row, NV)
        hm, hn = gather(total, at_total, HM), gather(total, at_total, HN)
        hmm, hmn, hnn = gather(total, at_total, HMM), gather(total, at_total, HMN), gather(total, at_total, HNN)
        scale = splat(TWO_LN_2)
        du, dv = scale * mu * hm, scale * fma(mv, hm, nv * hn)
        mu, mv, nv = scale * mu, scale * mv, scale * nv
        yxx, yxy = mu * mu * hmm, mu * fma(mv, hmm, nv * hmn)
        yyy = fma(mv * mv, hmm, fma(two * mv * nv, hmn, nv * nv * hnn))

        # Through P = (J V) (R S), one axis at a time.
        da0, da1, da2, db0, db1, db2 = zero, zero, zero, zero, zero, zero
        t0, t1, t2 = zero, zero, zero
        for axis in range(3):
            f = 24 + axis * 24
            c0, c1, c2 = (
                gather(geometry, at_axes, f),
                gather(geometry, at_axes, f + 8),
                gather(geometry, at_axes, f + 16),
            )
            p, q = fma(a0, c0, fma(a1, c1, a2 * c2)), fma(b0, c0, fma(b1, c1, b2 * c2))
            dp, dq = fma(yxx, p, yxy * q), fma(yxy, p, yyy * q)
            store(out, (3 + axis) * 8, fma(dp, p, dq * q))
            da0, da1, da2 = fma(dp, c0, da0), fma(dp, c1, da1), fma(dp, c2, da2)
            db0, db1, db2 = fma(dq, c0, db0), fma(dq, c1, db1), fma(dq, c2, db2)
            g0, g1, g2 = fma(dp, a0, dq * b0), fma(dp, a1, dq * b1), fma(dp, a2, dq * b2)
            t0, t1, t2 = t0 + fma(c1, g2, -(c2 * g1)), t1 + fma(c2, g0, -(c0 * g2)), t2 + fma(c0, g1, -(c1 * g0))
        w, x, y, z, norm, _ = unit_quats(quats, at_quat)
        over_norm = two / norm
        store(out, 48, -fma(t0, x, fma(t1, y, t2 * z)) * over_norm)
        store(out, 56, fma(w, t0, fma(t1, z, -(t2 * y))) * over_norm)
        store(out, 64, fma(w, t1, fma(t2, x, -(t0 * z))) * over_norm)
        store(out, 72, fma(w, t2, fma(t0, y, -(t1 * x))) * over_norm)

        # The mean: through its pixel, the two gains, the two sides and its depth; camera axes.
        inside_x = (tan_x >= x_low) & (tan_x <= x_high)
        inside_y = (tan_y >= y_low) & (tan_y <= y_high)
        d_side_x = select(inside_x, -gain_x * fma(da0, s20, fma(da1, s21, da2 * s22)), zero)
        d_side_y = select(inside_y, -gain_y * fma(db0, s20, fma(db1, s21, db2 * s22)), zero)
        d_tan_x, d_tan_y = fma(du, focal_x, d_side_x), fma(dv, focal_y, d_side_y)
        shrink = fma(da0, a0, fma(da1, a1, da2 * a2)) + fma(db0, b0, fma(db1, b1, db2 * b2))
        dx, dy = d_tan_x * over_z, d_tan_y * over_z
        dz = fma(-over_z, fma(d_tan_x, tan_x, fma(d_tan_y, tan_y, shrink)), gather(total, at_total, Z))
        d0 = fma(s00, dx, fma(s10, dy, s20 * dz))
        d1 = fma(s01, dx, fma(s11, dy, s21 * dz))
        d2 = fma(s02, dx, fma(s12, dy, s22 * dz))

        # Colour: nothing below black.
        red = select(gather(records, at_row, RED) > zero, gather(total, at_total, R), zero)
        green = select(gather(records, at_row, GREEN) > zero, gather(total, at_total, G), zero)
        blue = select(gather(records, at_row, BLUE) > zero, gather(total, at_total, B), zero)
        if degree > 0:
            read_coefficients(sh, at_sh, used * 3, numbers)
            inverse = one / square_root(fma(px, px, fma(py, py, pz * pz)))
            x, y, z = px * inverse, py * inverse, pz * inverse
            write_basis(degree, x, y, z, basis)
            e0, e1, e2 = pull_back_direction(degree, x, y, z, numbers, red, green, blue, slopes)
            along = fma(e0, x, fma(e1, y, e2 * z))
            d0 = fma(fma(-along, x, e0), inverse, d0)
            d1 = fma(fma(-along, y, e1), inverse, d1)
            d2 = fma(fma(-along, z, e2), inverse, d2)
        pull_back_coefficients(used, basis, red, green, blue, pulled)
        write_coefficients(pulled, used * 3, start, count, d_sh)

        store(out, 0, d0)
        store(out, 8, d1)
        store(out, 16, d2)
        opacity = exp_lanes(gather(records, at_row, LOG2_OPACITY) * splat(LN_2))
        store(out, 80, gather(total, at_total, H) * (one - opacity))
        du, dv = du * splat(half_size[0]), dv * splat(half_size[1])
        store(out, 88, square_root(fma(du, du, dv * dv)))
        for lane in range(count):
            k = start + lane
            for axis in range(3):
                put(d_means, 3 * k + axis, at(out, axis * 8 + lane))
                put(d_log_scales, 3 * k + axis, at(out, 24 + axis * 8 + lane))
            for part in range(4):
                put(d_quats, 4 * k + part, at(out, 48 + part * 8 + lane))
            put(d_opacity_logits, k, at(out, 80 + lane))
            put(norms, k, at(out, 88 + lane))
