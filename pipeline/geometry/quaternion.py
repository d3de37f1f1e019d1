"""Unit quaternions in wxyz order and rotation matrices, in float64."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def normalise_quats(quats: Float[np.ndarray, "*N 4"]) -> Float[np.ndarray, "*N 4"]:
    """Return unit quaternions in float64.

    The largest component is divided out first, so norms from 1e-300 to 1e300 keep full precision where
    squaring them would under- or overflow.

    Args:
        quats: Quaternions in wxyz order, any norm but zero.

    Returns:
        The same rotations with norm 1. A zero quaternion gives the identity rotation (1, 0, 0, 0).
    """
    q = np.asarray(quats, np.float64)
    largest = np.abs(q).max(axis=-1, keepdims=True)
    zero = largest[..., 0] == 0.0
    q = q / np.where(largest == 0.0, 1.0, largest)
    norm = np.sqrt((q * q).sum(axis=-1, keepdims=True))
    q = q / np.where(norm == 0.0, 1.0, norm)
    q[zero] = (1.0, 0.0, 0.0, 0.0)
    return q


def quats_to_rotations(quats: Float[np.ndarray, "*N 4"]) -> Float[np.ndarray, "*N 3 3"]:
    """Return the rotation matrices of quaternions (wxyz, any non-zero norm), in float64."""
    w, x, y, z = np.moveaxis(normalise_quats(quats), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotations_to_quats(rotations: Float[np.ndarray, "*N 3 3"]) -> Float[np.ndarray, "*N 4"]:
    """Return unit quaternions (wxyz, w >= 0) of rotation matrices, in float64.

    Of the four textbook formulas the one with the largest divisor is taken for each matrix, so no
    rotation is near a singularity.
    """
    r = np.asarray(rotations, np.float64)
    t = np.stack([r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]], axis=-1)
    trace = t.sum(axis=-1)
    # Row i of `table` is the unnormalised quaternion whose largest component is number i.
    diagonal = np.concatenate([(1 + trace)[..., None], 1 - trace[..., None] + 2 * t], axis=-1)
    zy, xz, yx = r[..., 2, 1], r[..., 0, 2], r[..., 1, 0]
    yz, zx, xy = r[..., 1, 2], r[..., 2, 0], r[..., 0, 1]
    table = np.stack(
        [
            np.stack([diagonal[..., 0], zy - yz, xz - zx, yx - xy], axis=-1),
            np.stack([zy - yz, diagonal[..., 1], yx + xy, xz + zx], axis=-1),
            np.stack([xz - zx, yx + xy, diagonal[..., 2], zy + yz], axis=-1),
            np.stack([yx - xy, xz + zx, zy + yz, diagonal[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = diagonal.argmax(axis=-1)
    chosen = np.take_along_axis(table, best[..., None, None], axis=-2)[..., 0, :]
    quats = normalise_quats(chosen)
    return np.where(quats[..., :1] < 0, -quats, quats)
