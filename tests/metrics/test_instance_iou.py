from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.instance_iou import instance_iou
from pipeline.metrics.iou import weighted_iou

INSTANCES = st.lists(st.lists(st.integers(0, 14), min_size=1, max_size=8), max_size=4)


def _arrays(instances: list[list[int]]) -> list[np.ndarray]:
    return [np.array(ids, np.int64) for ids in instances]


def _brute_force(predicted: list[np.ndarray], targets: list[np.ndarray], weights: np.ndarray) -> float:
    """The best sum over every one-to-one assignment, tried one by one."""
    if not predicted and not targets:
        return 1.0
    short, long = sorted((predicted, targets), key=len)
    sums = [
        sum(weighted_iou(a, b, weights) for a, b in zip(short, order, strict=True))
        for order in itertools.permutations(long, len(short))
    ]
    return max(sums) / len(long)


@settings(deadline=None)  # the first call imports SciPy
@given(INSTANCES, INSTANCES, st.integers(0, 1000))
def test_score_equals_the_best_of_all_assignments(
    predicted: list[list[int]], targets: list[list[int]], seed: int
) -> None:
    weights = np.random.default_rng(seed).uniform(0.01, 1, 15)
    found = instance_iou(_arrays(predicted), _arrays(targets), weights)
    assert found.score == pytest.approx(_brute_force(_arrays(predicted), _arrays(targets), weights))
    assert found.true_positives == len(found.pairs) == min(len(predicted), len(targets))
    assert found.true_positives + found.false_positives == len(predicted)
    assert found.true_positives + found.false_negatives == len(targets)


@settings(deadline=None)
@given(INSTANCES, st.randoms(use_true_random=False))
def test_order_of_predictions_does_not_change_the_score(instances: list[list[int]], random: object) -> None:
    weights = np.linspace(0.1, 1, 15)
    shuffled = list(instances)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    score = instance_iou(_arrays(instances), _arrays(instances), weights).score
    assert score == 1.0
    assert instance_iou(_arrays(shuffled), _arrays(instances), weights).score == 1.0


class TestZeroTargets:
    def test_nothing_predicted_scores_one(self) -> None:
        found = instance_iou([], [], np.ones(3))
        assert (found.score, found.true_positives, found.false_positives, found.false_negatives) == (1.0, 0, 0, 0)

    def test_anything_predicted_scores_zero(self) -> None:
        found = instance_iou(_arrays([[0], [1]]), [], np.ones(3))
        assert (found.score, found.true_positives, found.false_positives, found.false_negatives) == (0.0, 0, 2, 0)

    def test_targets_without_prediction_score_zero(self) -> None:
        found = instance_iou([], _arrays([[0], [1], [2]]), np.ones(3))
        assert (found.score, found.true_positives, found.false_positives, found.false_negatives) == (0.0, 0, 0, 3)


def test_assigned_pairs_without_overlap_are_true_positives_of_iou_zero() -> None:
    found = instance_iou(_arrays([[0]]), _arrays([[1]]), np.ones(3))
    assert (found.score, found.true_positives) == (0.0, 1)


def test_a_prediction_too_many_lowers_the_score() -> None:
    assert instance_iou(_arrays([[0], [2]]), _arrays([[0]]), np.ones(3)).score == 0.5


def test_an_empty_predicted_instance_counts_as_a_prediction() -> None:
    assert instance_iou(_arrays([[0], []]), _arrays([[0]]), np.ones(3)).score == 0.5
