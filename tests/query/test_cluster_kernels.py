from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.cluster_quality import adjusted_rand
from pipeline.query.cluster_kernels import select_clusters


def _clumps(rng: np.random.Generator) -> np.ndarray:
    """Clumps of clumps of clumps, of unequal sizes and densities."""
    centres = rng.uniform(-2, 2, (int(rng.integers(1, 4)), 3))
    for spread in (0.4, 0.12):
        centres = np.repeat(centres, int(rng.integers(1, 4)), axis=0)
        centres = centres + rng.normal(0, spread, centres.shape)
    return np.concatenate(
        [centre + rng.normal(0, rng.choice([0.01, 0.03, 0.1]), (int(rng.integers(5, 60)), 3)) for centre in centres]
    )


def _random_tree(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joins of random nodes at rising distances."""
    free, left, right = list(range(count)), [], []
    for join in range(count - 1):
        pair = rng.choice(len(free), 2, replace=False)
        left.append(free[pair[0]])
        right.append(free[pair[1]])
        free = [node for place, node in enumerate(free) if place not in pair] + [count + join]
    return np.array(left, np.int64), np.array(right, np.int64), np.sort(rng.uniform(0.1, 1.0, count - 1))


@pytest.mark.parametrize("epsilon", [0.0, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("least", [2, 8, 25])
def test_select_clusters_with_weights_of_one_gives_what_the_hdbscan_library_gives(epsilon: float, least: int) -> None:
    from hdbscan import HDBSCAN

    rng = np.random.default_rng(int(100 * epsilon) + least)
    for _ in range(8):
        points = _clumps(rng)
        if len(points) < max(least, 12):
            continue
        model = HDBSCAN(
            min_cluster_size=least,
            min_samples=10,
            cluster_selection_epsilon=epsilon,
            algorithm="boruvka_kdtree",
            approx_min_span_tree=False,
            core_dist_n_jobs=1,
            allow_single_cluster=True,
        ).fit(points)
        tree = model.single_linkage_tree_.to_numpy()
        left, right = tree[:, 0].astype(np.int64), tree[:, 1].astype(np.int64)
        ones = np.ones(len(points), np.int64)
        labels = select_clusters(left, right, tree[:, 2].copy(), ones, least, epsilon, 0.0)
        np.testing.assert_array_equal(labels < 0, model.labels_ < 0)
        assert adjusted_rand(labels, model.labels_) == 1.0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 25), st.integers(2, 12), st.sampled_from([0.0, 0.3, 0.6]))
def test_a_leaf_of_weight_w_counts_as_w_points_at_one_place(seed: int, count: int, least: int, epsilon: float) -> None:
    rng = np.random.default_rng(seed)
    left, right, distances = _random_tree(count, rng)
    weights = rng.integers(1, 2 * least, count)
    got = select_clusters(left, right, distances, weights, least, epsilon, 0.0)

    # The same tree with every leaf spelt out: its points join at distance 0 first.
    owner = np.repeat(np.arange(count), weights)
    total = len(owner)
    node_of, inner_left, inner_right = np.empty(2 * count - 1, np.int64), [], []
    for leaf in range(count):
        own = np.flatnonzero(owner == leaf)
        node_of[leaf] = own[0]
        for point in own[1:]:
            inner_left.append(node_of[leaf])
            inner_right.append(point)
            node_of[leaf] = total + len(inner_left) - 1
    for join in range(count - 1):
        node_of[count + join] = total + len(inner_left) + join
    spelt = select_clusters(
        np.concatenate([inner_left, node_of[left]]).astype(np.int64),
        np.concatenate([inner_right, node_of[right]]).astype(np.int64),
        np.concatenate([np.zeros(len(inner_left)), distances]),
        np.ones(total, np.int64),
        least,
        epsilon,
        0.0,
    )
    np.testing.assert_array_equal(spelt < 0, got[owner] < 0)
    assert adjusted_rand(spelt, got[owner]) == 1.0


def test_one_leaf_that_is_enough_points_is_a_cluster_and_one_that_is_not_is_noise() -> None:
    left, right, far = np.array([0], np.int64), np.array([1], np.int64), np.array([5.0])
    labels = select_clusters(left, right, far, np.array([30, 4], np.int64), 20, 0.5, 0.1)
    assert labels.tolist() == [0, -1]
    labels = select_clusters(left, right, far, np.array([30, 40], np.int64), 20, 0.5, 0.1)
    assert sorted(labels.tolist()) == [0, 1]
