"""3D covariances of Gaussians, R S S^T R^T, in float64."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from pipeline.geometry.quaternion import quats_to_rotations


def covariances(quats: Float[np.ndarray, "M 4"], log_scales: Float[np.ndarray, "M 3"]) -> Float[np.ndarray, "M 3 3"]:
    """Return the 3D covariances in square metres (paper, supplement A.1).

    Args:
        quats: Rotations, wxyz, any non-zero norm.
        log_scales: Natural logarithm of the standard deviation along each local axis, metres.
    """
    axes = quats_to_rotations(quats) * np.exp(np.asarray(log_scales, np.float64))[:, None, :]
    return axes @ np.swapaxes(axes, -1, -2)
