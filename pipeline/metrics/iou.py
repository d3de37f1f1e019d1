"""3D IoU of two sets of Gaussians, weighted by their volumes (paper, supplement B.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int


def weighted_iou(
    predicted: Int[np.ndarray, "P"], target: Int[np.ndarray, "T"], weights: Float[np.ndarray, "M"]
) -> float:
    """Return the summed weight of the intersection over that of the union, 0 to 1.

    Both sets empty is 1: nothing was wanted and nothing was found. A union that weighs nothing though it has
    members is 1 when the sets are equal and 0 otherwise.

    Args:
        predicted: Indices of the predicted Gaussians, any order; repeats count once.
        target: Indices of the ground-truth Gaussians, any order; repeats count once.
        weights: w_j of every Gaussian of the scene, at least 0.
    """
    predicted, target = np.unique(predicted), np.unique(target)
    common = np.intersect1d(predicted, target, assume_unique=True)
    shared = math.fsum(weights[common])
    union = math.fsum(weights[np.union1d(predicted, target)])
    if union == 0.0:
        return float(len(common) == len(predicted) == len(target))
    return min(shared / union, 1.0)


def mean_iou(ious: Sequence[float]) -> float:
    """Return the mean over questions (3D mIoU), 0 to 1; NaN for no question, the value itself for one."""
    return math.fsum(ious) / len(ious) if ious else math.nan
