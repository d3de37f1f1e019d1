from __future__ import annotations

import math

import pytest

from pipeline.metrics.accuracy import accuracy_at


def test_accuracy_counts_ious_above_the_threshold() -> None:
    ious = [0.0, 0.05, 0.09, 0.11, 0.5, 1.0]
    assert accuracy_at(ious, 8) == pytest.approx(4 / 6)
    assert accuracy_at(ious, 10) == pytest.approx(3 / 6)
    assert accuracy_at(ious, 100) == 0.0


@pytest.mark.parametrize("k", [1, 7, 8, 10, 14, 25, 28, 29, 50, 55, 57, 58])
def test_an_iou_of_exactly_k_percent_does_not_count(k: int) -> None:
    assert accuracy_at([k / 100], k) == 0.0


def test_accuracy_is_nan_for_no_question_and_zero_or_one_for_one() -> None:
    assert math.isnan(accuracy_at([], 8))
    assert accuracy_at([0.2], 8) == 1.0
    assert accuracy_at([0.02], 8) == 0.0
