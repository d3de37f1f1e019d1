"""The viewing frustum F(H) of the paper (section 3.4): image bounds and near/far planes, no occlusion."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from pipeline.geometry.camera import Camera

DEFAULT_NEAR_M = 0.2
"""Near plane of the reference rasteriser."""
DEFAULT_FAR_M = 100.0
"""Farther than any indoor scene: the paper gives no far plane, so ours cuts nothing indoors."""


def points_in_frustum(
    camera: Camera,
    points: Float[np.ndarray, "N 3"],
    *,
    near_m: float = DEFAULT_NEAR_M,
    far_m: float = DEFAULT_FAR_M,
) -> Bool[np.ndarray, "N"]:
    """Return which world points (metres) project inside the image with z-depth in (near, far]."""
    pixels, depth = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    return inside & (depth > near_m) & (depth <= far_m)
