from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import cophenet
from scipy.spatial.distance import pdist, squareform

from pipeline.query.cluster_tree import linkage_tree

EXACT = 1e-12
"""Both sides take square roots of the same sums, in another order."""


def _reachability(points: np.ndarray, weights: np.ndarray, min_samples: int) -> np.ndarray:
    """Mutual reachability of all pairs, from its definition."""
    apart = squareform(pdist(points))
    cores = np.empty(len(points))
    for row, distances in enumerate(apart):
        order = np.argsort(distances, kind="stable")
        others = np.cumsum(weights[order]) - 1
        enough = np.flatnonzero(others >= min_samples)
        place = enough[0] if len(enough) else len(points) - 1
        cores[row] = distances[order[place]]
    reach = np.maximum(apart, np.maximum(cores[:, None], cores[None, :]))
    np.fill_diagonal(reach, 0)
    return reach


def _heights(points: np.ndarray, weights: np.ndarray, min_samples: int) -> np.ndarray:
    """For each pair the distance at which single linkage joins it: the same for every least spanning tree."""
    tree = linkage_tree(points, weights, min_samples)
    sizes = [1] * len(points)
    for a, b in zip(tree.left, tree.right, strict=True):
        sizes.append(sizes[a] + sizes[b])
    assert sizes[-1] == len(points)
    table = np.stack([tree.left, tree.right, tree.distances, sizes[len(points) :]], axis=1)
    assert len(tree.distances) == len(points) - 1
    return squareform(cophenet(table.astype(float)))


def _points(kind: str, count: int, rng: np.random.Generator) -> np.ndarray:
    if kind == "clumps":
        return rng.normal(0, 0.05, (count, 3)) + 2 * rng.integers(0, 3, (count, 1))
    if kind == "grid":
        return rng.integers(0, 4, (count, 3)).astype(float)
    if kind == "line":
        return np.outer(np.arange(count, dtype=float) ** 1.5, [1.0, 0.0, 0.0])
    return np.ones((count, 3))


def _expected_heights(reach: np.ndarray) -> np.ndarray:
    """The least, over all paths, of the longest step (Floyd and Warshall)."""
    best = reach.copy()
    for through in range(len(best)):
        best = np.minimum(best, np.maximum(best[:, through, None], best[None, through, :]))
    return best


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 90),
    st.integers(1, 12),
    st.sampled_from(["clumps", "grid", "line", "same"]),
    st.booleans(),
)
def test_linkage_tree_joins_every_pair_at_its_bottleneck(
    seed: int, count: int, min_samples: int, kind: str, weighted: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = _points(kind, count, rng)
    weights = rng.integers(1, 6, count) if weighted else np.ones(count, np.int64)
    expected = _expected_heights(_reachability(points, weights, min_samples))
    np.testing.assert_allclose(_heights(points, weights, min_samples), expected, rtol=0, atol=EXACT)


def test_linkage_tree_of_many_points_is_as_long_as_the_library_s() -> None:
    from hdbscan import HDBSCAN

    rng = np.random.default_rng(3)
    centres = rng.uniform(-3, 3, (12, 3))
    points = centres[rng.integers(0, 12, 6000)] + rng.normal(0, 0.2, (6000, 3)) * (1, 1, 0.02)
    tree = linkage_tree(points, np.ones(6000, np.int64), 10)
    model = HDBSCAN(min_samples=10, algorithm="boruvka_kdtree", approx_min_span_tree=False, core_dist_n_jobs=1).fit(
        points
    )
    expected = model.single_linkage_tree_.to_numpy()[:, 2]
    np.testing.assert_allclose(tree.distances, np.sort(expected), rtol=0, atol=1e-9)


def test_linkage_tree_of_one_point_joins_nothing() -> None:
    tree = linkage_tree(np.zeros((1, 3)), np.ones(1, np.int64), 10)
    assert len(tree.left) == len(tree.right) == len(tree.distances) == 0


@pytest.mark.parametrize("count", [2, 8, 9, 17, 1000])
def test_split_makes_runs_that_do_not_overlap_along_the_widest_axis(count: int) -> None:
    from pipeline.query.cluster_tree_kernels import boxes, split

    points = np.random.default_rng(count).normal(size=(count, 3)) * (5, 1, 0.1)
    order = split(points)
    assert sorted(order.tolist()) == list(range(count))
    runs, bounds, least = boxes(points[order], np.arange(count, dtype=float))
    leaves = runs[len(runs) // 2 :]
    assert leaves[:, 0].tolist() == [0, *leaves[:-1, 1].tolist()]
    assert leaves[-1, 1] == count
    for (low, high), box, smallest in zip(runs, bounds, least, strict=True):
        own = points[order[low:high]]
        np.testing.assert_array_equal(box, [*own.min(axis=0), *own.max(axis=0)])
        assert smallest == low
    if count > 8:
        assert bounds[1, 3] <= bounds[2, 0]
