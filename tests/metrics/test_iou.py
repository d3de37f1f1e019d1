from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.metrics.iou import mean_iou, weighted_iou

IDS = st.lists(st.integers(0, 19), max_size=30)


def _ids(values: list[int]) -> np.ndarray:
    return np.array(values, np.int64)


@given(IDS, IDS, st.integers(0, 1000))
def test_weighted_iou_equals_the_sum_over_a_set_written_out(predicted: list[int], target: list[int], seed: int) -> None:
    weights = np.random.default_rng(seed).uniform(0.01, 1, 20)
    union = set(predicted) | set(target)
    expected = sum(weights[j] for j in set(predicted) & set(target)) / sum(weights[j] for j in union) if union else 1.0
    found = weighted_iou(_ids(predicted), _ids(target), weights)
    assert found == pytest.approx(expected)
    assert 0 <= found <= 1
    assert found == weighted_iou(_ids(target), _ids(predicted), weights)


def test_iou_of_a_set_with_itself_is_one_and_with_nothing_is_zero() -> None:
    weights = np.ones(10)
    assert weighted_iou(_ids([1, 2, 3]), _ids([3, 2, 1, 1]), weights) == 1.0
    assert weighted_iou(_ids([]), _ids([3]), weights) == 0.0
    assert weighted_iou(_ids([3]), _ids([]), weights) == 0.0
    assert weighted_iou(_ids([]), _ids([]), weights) == 1.0


def test_weightless_sets_count_as_equal_only_when_they_are() -> None:
    weights = np.zeros(5)
    assert weighted_iou(_ids([1, 2]), _ids([2, 1]), weights) == 1.0
    assert weighted_iou(_ids([1]), _ids([2]), weights) == 0.0


def test_heavy_gaussians_count_more() -> None:
    weights = np.array([1.0, 0.25, 0.25])
    assert weighted_iou(_ids([0, 1]), _ids([0, 2]), weights) == pytest.approx(1 / 1.5)


def test_mean_iou_is_nan_for_no_question_and_the_value_for_one() -> None:
    assert math.isnan(mean_iou([]))
    assert mean_iou([0.3]) == 0.3
    assert mean_iou([0.0, 1.0, 0.5]) == 0.5
