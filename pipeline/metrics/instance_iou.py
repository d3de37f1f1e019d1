"""Instance-aware 3D mIoU of one multi-target question (paper, supplement B.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pipeline.metrics.iou import weighted_iou


@dataclass(frozen=True, slots=True)
class InstanceScore:
    """How predicted instances meet the targets."""

    score: float
    """Sum of assigned IoUs over TP + FP + FN, 0 to 1; 1 when nothing was wanted and nothing was predicted."""
    pairs: tuple[tuple[int, int, float], ...]
    """Assigned (prediction, target, IoU), by prediction."""
    true_positives: int
    """Assigned pairs, however low their IoU: the paper applies no threshold."""
    false_positives: int
    """Predictions left over."""
    false_negatives: int
    """Targets left over."""


def instance_iou(
    predicted: Sequence[Int[np.ndarray, "_"]],
    targets: Sequence[Int[np.ndarray, "_"]],
    weights: Float[np.ndarray, "M"],
) -> InstanceScore:
    """Return the score of the one-to-one assignment that maximises the summed IoU.

    Every prediction is assigned while targets last, so TP + FP + FN is the larger of the two counts. A zero-target
    question scores 1 if nothing is predicted and 0 otherwise.

    Args:
        predicted: Gaussian indices of each predicted instance.
        targets: Gaussian indices of each ground-truth instance.
        weights: w_j of every Gaussian of the scene.
    """
    if not predicted and not targets:
        return InstanceScore(1.0, (), 0, 0, 0)
    # SciPy costs a quarter of a second to import, which a command line that only reads configs should not pay.
    from scipy.optimize import linear_sum_assignment

    table = np.array([[weighted_iou(p, t, weights) for t in targets] for p in predicted], np.float64)
    rows, columns = linear_sum_assignment(-table.reshape(len(predicted), len(targets)))
    pairs = tuple((int(p), int(t), float(table[p, t])) for p, t in zip(rows, columns, strict=True))
    larger = max(len(predicted), len(targets))
    return InstanceScore(
        score=math.fsum(iou for _, _, iou in pairs) / larger,
        pairs=pairs,
        true_positives=len(pairs),
        false_positives=len(predicted) - len(pairs),
        false_negatives=len(targets) - len(pairs),
    )
