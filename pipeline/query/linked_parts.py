"""Which points hang together when steps of a given length are taken: single linkage, cut."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int

from pipeline.query.cluster_tree import linkage_tree


def linked_parts(points: Float64[np.ndarray, "n 3"], within_m: float) -> Int[np.ndarray, "n"]:
    """Return a number from 0 per point, equal where steps of at most `within_m` lead from one to the other.

    Args:
        points: Metres.
        within_m: Longest step, metres.
    """
    if len(points) == 0:
        return np.empty(0, np.int64)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # With one neighbour the mutual reachability of two points is their distance.
    tree = linkage_tree(points - points.mean(axis=0), np.ones(len(points), np.int64), 1)
    short = tree.distances <= within_m
    nodes, count = len(points) + np.flatnonzero(short), len(points) + len(tree.distances)
    ends = np.concatenate([nodes, nodes]), np.concatenate([tree.left[short], tree.right[short]])
    graph = coo_array((np.ones(2 * len(nodes), np.int8), ends), shape=(count, count))
    labels = connected_components(graph, directed=False)[1][: len(points)]
    return np.unique(labels, return_inverse=True)[1].reshape(-1)
