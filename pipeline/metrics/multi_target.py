"""Multi3DRefer's scores of one question: F1 of matched instances at an IoU threshold, and zero targets.

The matching is that of `instance_iou`: IoUs alone decide it, the threshold only counts (M3DRef-CLIP's evaluation, which
pads the IoU table with zeros to a square; that adds pairs of IoU 0 and changes no other).
"""

from __future__ import annotations

from collections.abc import Sequence

F1_PERCENTS = (25, 50)
"""IoU thresholds of Multi3DRefer, percent."""


def f1_score(pair_ious: Sequence[float], predicted: int, targets: int, percent: float | int) -> float:
    """Return 2 TP / (predicted + targets), 0 to 1; without targets 1 if nothing was predicted and 0 otherwise.

    A pair is a true positive from an IoU of the threshold on, unlike in Acc@k, where the IoU has to exceed it. Where
    several assignments have the same summed IoU, the one found decides.

    Args:
        pair_ious: IoU of each prediction assigned to a target.
        predicted: Predicted instances, assigned or not.
        targets: Ground-truth instances.
        percent: Threshold, percent, above 0.

    Raises:
        ValueError: There are more pairs than predictions or targets, or the threshold counts pairs that do not touch.
    """
    if len(pair_ious) > min(predicted, targets):
        raise ValueError(f"f1_score: {len(pair_ious)} pairs of {predicted} predictions and {targets} targets")
    if percent <= 0:
        raise ValueError(f"f1_score: the threshold must be above 0, got {percent}")
    if targets == 0:
        return zero_target_score(predicted)
    return 2 * sum(iou >= percent / 100.0 for iou in pair_ious) / (predicted + targets)


def zero_target_score(predicted: int) -> float:
    """Return 1 if nothing was predicted for a question without targets, 0 otherwise."""
    return float(predicted == 0)
