"""Quaternions stored as their three smallest components and the place of the largest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Integer

SQRT_HALF = float(np.sqrt(0.5))
"""No component but the largest of a unit quaternion can exceed it."""

_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


def quats_from_three(largest: Integer[np.ndarray, "M"], others: Float[np.ndarray, "M 3"]) -> Float32[np.ndarray, "M 4"]:
    """Return quaternions with the component at `largest` (0 to 3) restored so that their norm is 1.

    Args:
        largest: Place of the component left out.
        others: The three stored components in their order; the sum of squares is held to at most 1.
    """
    quats = np.empty((len(largest), 4), np.float32)
    missing = np.sqrt(np.maximum(0, 1 - (others * others).sum(axis=1)))
    rows = np.arange(len(largest))
    quats[rows[:, None], _OTHERS[largest]] = others
    quats[rows, largest] = missing
    return quats
