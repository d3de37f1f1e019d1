"""Acc@k: how many questions were grounded with an IoU above k percent (paper 4.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence


def accuracy_at(ious: Sequence[float], k_percent: float | int) -> float:
    """Return the share of questions whose IoU exceeds k percent, 0 to 1; NaN for no question, 0 or 1 for one.

    The comparison is strict: an IoU of exactly k percent does not count.

    Args:
        ious: One IoU per question, 0 to 1.
        k_percent: Threshold, percent, such as the paper's 8 and 10.
    """
    # k/100 is compared, not 100*iou: 0.07 * 100 exceeds 7 by rounding alone.
    return sum(iou > k_percent / 100.0 for iou in ious) / len(ious) if ious else math.nan
