"""Gaussians as a browser draws them: covariances, one colour each, and not more than it can bear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int, Int64

from pipeline.geometry.covariance import covariances
from pipeline.scene.formats.raw import SH_C0
from pipeline.scene.gaussians import Gaussians

SLICE = 1 << 16
"""Gaussians whose float64 covariances are in memory at once."""


@dataclass(frozen=True, slots=True)
class Splats:
    """K Gaussians for the browser."""

    centers: Float32[np.ndarray, "K 3"]
    """Metres, world frame."""
    covariances: Float32[np.ndarray, "K 3 3"]
    """Square metres."""
    colors: Float32[np.ndarray, "K 3"]
    """RGB, 0 to 1, without what depends on the direction."""
    opacities: Float32[np.ndarray, "K 1"]
    """0 to 1."""


def most_visible(gaussians: Gaussians, most: int) -> Int64[np.ndarray, "_"]:
    """Return the sorted ids of the `most` Gaussians with the largest opacity times cross-section; ties to the lower id.

    Args:
        gaussians: The scene.
        most: How many are kept at most.
    """
    if len(gaussians) <= most:
        return np.arange(len(gaussians))
    axes = np.sort(gaussians.log_scales, axis=1)
    weight = axes[:, 1] + axes[:, 2] - np.logaddexp(0.0, -gaussians.opacity_logits)
    return np.sort(np.argsort(-weight, kind="stable")[:most])


def splats_of(gaussians: Gaussians, ids: Int[np.ndarray, "K"]) -> Splats:
    """Return some Gaussians as the browser draws them."""
    chosen = np.empty((len(ids), 3, 3), np.float32)
    for start in range(0, len(ids), SLICE):
        some = ids[start : start + SLICE]
        chosen[start : start + SLICE] = covariances(gaussians.quats[some], gaussians.log_scales[some])
    colors = np.clip(0.5 + np.float32(SH_C0) * gaussians.sh[ids, 0], 0.0, 1.0)
    opacities = np.exp(-np.logaddexp(0.0, -gaussians.opacity_logits[ids]))
    return Splats(gaussians.means[ids], chosen, colors, opacities[:, None])
