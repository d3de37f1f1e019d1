"""Opacity-weighted volumes of Gaussians and the weights every 3D grounding score is computed with."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, Int32

from pipeline.scene.semantics import UNLABELLED

Weighting = Literal["percentile", "lightgaussian"]
"""percentile: the paper's rule; lightgaussian: that of LightGaussian, which the paper cites but does not follow."""

REFERENCE_PERCENTILE = 90.0
"""Percentile of the volumes that weighs 1 (paper, supplement B.4)."""
LIGHTGAUSSIAN_POWER = 0.1
"""Exponent of LightGaussian's ratio."""


def volumes(log_scales: Float32[np.ndarray, "M 3"], opacity_logits: Float32[np.ndarray, "M"]) -> Float[np.ndarray, "M"]:
    """Return Volume(G_j) = sx sy sz alpha in cubic metres, float64 (paper, supplement B.4).

    Args:
        log_scales: Natural logarithm of the scales, metres; -inf is a flat axis and gives 0.
        opacity_logits: Opacities before the sigmoid.
    """
    logits = np.asarray(opacity_logits, np.float64)
    # The sigmoid through logaddexp never overflows, and infinite logits give exactly 0 and 1.
    return np.exp(np.asarray(log_scales, np.float64).sum(axis=1)) * np.exp(-np.logaddexp(0.0, -logits))


def gaussian_weights(
    log_scales: Float32[np.ndarray, "M 3"],
    opacity_logits: Float32[np.ndarray, "M"],
    weighting: Weighting = "percentile",
    instance: Int32[np.ndarray, "M"] | None = None,
) -> Float[np.ndarray, "M"]:
    """Return the weight w_j of every Gaussian, 0 to 1, float64 (paper, supplement B.4).

    The reference volume is taken over all Gaussians of the scene. Where it is 0 (most Gaussians are flat or
    transparent) a ratio means nothing: Gaussians with a volume weigh 1 and the others 0. M = 0 gives no weights.

    Args:
        log_scales: Natural logarithm of the scales, metres.
        opacity_logits: Opacities before the sigmoid.
        weighting: "percentile" divides by the 90th percentile and clips to [0, 1]. "lightgaussian" takes
            (V / V_ref)^0.1 clipped to [0, 1], without opacity, V_ref being the 10th percentile: its code takes
            index 0.9 M of a descending sort.
        instance: Ground-truth instance of each Gaussian. Unlabelled ones (-1) weigh 0: they are ignored, so that a
            prediction neither gains nor loses by them; the reference volume is that of all. None: all are labelled.
    """
    if weighting == "percentile":
        volume, percentile, power = volumes(log_scales, opacity_logits), REFERENCE_PERCENTILE, 1.0
    else:
        volume = np.exp(np.asarray(log_scales, np.float64).sum(axis=1))
        percentile, power = 100.0 - REFERENCE_PERCENTILE, LIGHTGAUSSIAN_POWER
    if not len(volume):
        return volume
    reference = float(np.percentile(volume, percentile))
    if reference == 0.0:
        weights = (volume > 0).astype(np.float64)
    else:
        weights = np.clip(volume / reference, 0.0, 1.0) ** power
    if instance is not None:
        weights[instance == UNLABELLED] = 0.0
    return weights
