"""Colour to spherical harmonics: the colour seen on average, and a mild highlight that depends on the direction."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

C0 = 0.28209479177387814
"""Constant basis function of degree 0."""

BAND_SHARE = (0.0, 1.0, 0.6, 0.3)
"""Height of each band's lobe relative to the gloss: higher bands narrow the highlight."""


def basis(degree: int, direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n K"]:
    """Return the real spherical harmonics up to `degree` (0 to 3) in unit directions, in the order 3DGS stores them."""
    x, y, z = direction.T
    columns = [np.full(len(x), C0)]
    if degree > 0:
        c1 = 0.4886025119029199
        columns += [-c1 * y, c1 * z, -c1 * x]
    if degree > 1:
        c2 = 1.0925484305920792
        columns += [
            c2 * x * y,
            -c2 * y * z,
            0.31539156525252005 * (3 * z * z - 1),
            -c2 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree > 2:
        columns += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5 * z * z - 1),
            0.3731763325901154 * z * (5 * z * z - 3),
            -0.4570457994644658 * x * (5 * z * z - 1),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return np.stack(columns, axis=1)


def to_sh(
    color: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"], gloss: Float[np.ndarray, "n"], degree: int
) -> Float32[np.ndarray, "n K 3"]:
    """Return coefficients whose value is `color` plus a white lobe for eyes that see the surface head on.

    By the addition theorem sum_m Y_lm(a) Y_lm(b) = (2l + 1) / (4 pi) P_l(a . b), so coefficients
    g 4 pi / (2l + 1) Y_lm(-normal) give g P_l(cos) in band l.

    Args:
        color: sRGB seen on average over directions, 0 to 1.
        normal: Unit outward normals.
        gloss: Height g of the degree 1 lobe.
        degree: 0 to 3; 0 leaves the highlight out.
    """
    sh = np.empty((len(color), (degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (color - 0.5) / C0
    if degree:
        lobes = basis(degree, -normal)
        for band in range(1, degree + 1):
            columns = slice(band * band, (band + 1) ** 2)
            scale = gloss * BAND_SHARE[band] * 4 * np.pi / (2 * band + 1)
            sh[:, columns] = (scale[:, None] * lobes[:, columns])[:, :, None]
    return sh
