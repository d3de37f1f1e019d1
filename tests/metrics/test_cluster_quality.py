from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.cluster_quality import SHARE, adjusted_rand, apart, cluster_quality

LABELS = st.lists(st.tuples(st.integers(-1, 4), st.integers(-1, 4)), max_size=60)


def _columns(pairs: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    table = np.array(pairs, np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


@settings(deadline=None)
@given(LABELS)
def test_adjusted_rand_equals_an_independent_implementation(pairs: list[tuple[int, int]]) -> None:
    from sklearn.metrics import adjusted_rand_score

    first, second = _columns(pairs)
    expected = adjusted_rand_score(first, second) if len(first) > 1 else 1.0
    assert adjusted_rand(first, second) == pytest.approx(expected, abs=1e-12)


def test_adjusted_rand_of_a_million_points_does_not_overflow() -> None:
    labels = np.arange(1_000_000) % 7
    assert adjusted_rand(labels, labels + 3) == 1.0
    assert abs(adjusted_rand(labels, np.arange(1_000_000) // 7 % 5)) < 1e-4


@pytest.mark.parametrize("count", [0, 1])
def test_adjusted_rand_of_fewer_than_two_points_is_one(count: int) -> None:
    assert adjusted_rand(np.zeros(count, int), np.ones(count, int)) == 1.0


@pytest.mark.parametrize("labels", [[0] * 9, list(range(9))])
def test_adjusted_rand_of_equal_trivial_partitions_is_one(labels: list[int]) -> None:
    assert adjusted_rand(np.array(labels), np.array(labels)) == 1.0


def test_one_cluster_for_each_instance_is_perfect() -> None:
    truth = np.repeat([7, 3, 5], [40, 30, 20])
    quality = cluster_quality(truth, np.repeat([0, 1, 2], [40, 30, 20]))
    assert (quality.points, quality.instances, quality.clusters, quality.dropped) == (90, 3, 3, 0)
    assert (quality.ari, quality.over_split, quality.under_split, quality.matched) == (1.0, 0, 0, 3)


def test_an_instance_in_two_clusters_is_over_split_only_when_both_hold_a_share_of_it() -> None:
    truth = np.zeros(100, int)
    edge = int(100 * SHARE)
    halves, rim = np.zeros(100, int), np.zeros(100, int)
    halves[:edge], rim[: edge - 1] = 1, 1
    assert cluster_quality(truth, halves).over_split == 1
    assert cluster_quality(truth, rim).over_split == 0
    assert cluster_quality(truth, halves).matched == 1


def test_a_cluster_over_two_instances_is_under_split_whatever_their_sizes() -> None:
    truth = np.repeat([0, 1, 2], [1000, 20, 50])
    quality = cluster_quality(truth, np.repeat([0, 0, 1], [1000, 20, 50]))
    assert (quality.under_split, quality.over_split, quality.matched) == (1, 0, 2)


def test_dropped_points_lower_the_ari_and_match_nothing() -> None:
    truth = np.repeat([0, 1], [50, 50])
    quality = cluster_quality(truth, np.repeat([0, -1], [50, 50]))
    assert (quality.clusters, quality.dropped, quality.matched) == (1, 50, 1)
    assert quality.ari is not None
    assert quality.ari < 0.7
    assert (quality.over_split, quality.under_split) == (0, 0)


def test_points_of_unknown_instance_are_left_out() -> None:
    truth, found = np.array([0, 0, -1, -1, 1, 1]), np.array([0, 0, 0, 1, 1, 1])
    assert cluster_quality(truth, found) == cluster_quality(truth[truth >= 0], found[truth >= 0])
    nothing = cluster_quality(np.full(4, -1), np.zeros(4, int))
    assert (nothing.ari, nothing.points, nothing.instances, nothing.clusters, nothing.matched) == (None, 0, 0, 0, 0)


@settings(deadline=None)
@given(LABELS)
def test_cluster_quality_follows_its_definitions(pairs: list[tuple[int, int]]) -> None:
    truth, found = _columns(pairs)
    quality = cluster_quality(truth, found)
    truth, found = truth[truth >= 0], found[truth >= 0]
    instances, clusters = set(truth.tolist()), set(found.tolist()) - {-1}

    def share(instance: int, cluster: int) -> float:
        return float(((truth == instance) & (found == cluster)).sum() / (truth == instance).sum())

    def iou(instance: int, cluster: int) -> float:
        return float(
            ((truth == instance) & (found == cluster)).sum() / ((truth == instance) | (found == cluster)).sum()
        )

    assert quality.over_split == sum(sum(share(i, c) >= SHARE for c in clusters) > 1 for i in instances)
    assert quality.under_split == sum(sum(share(i, c) >= SHARE for i in instances) > 1 for c in clusters)
    assert quality.matched == sum(any(iou(i, c) > 0.5 for c in clusters) for i in instances)
    assert quality.dropped == int((found == -1).sum())
    assert (quality.instances, quality.clusters) == (len(instances), len(clusters))


def test_apart_gives_each_unclustered_point_a_number_of_its_own() -> None:
    labels = apart(np.array([-1, 2, -1, 0, 2]))
    assert len(set(labels.tolist())) == 4
    assert labels[[1, 3, 4]].tolist() == [2, 0, 2]
    assert apart(np.array([-1, -1])).tolist() == [0, 1]
