"""Single linkage of points by mutual reachability: the tree that HDBSCAN cuts, exact, in seconds for a million."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

QUERIED = 1 << 16
"""Points asked for their neighbours at a time: bounds the memory of the answer."""


@dataclass(frozen=True, slots=True)
class LinkageTree:
    """Single linkage of m leaves: node m + i joins two nodes, shortest distance first."""

    left: Int64[np.ndarray, "joins"]
    """One node of each of the m - 1 joins; below m it is a leaf."""
    right: Int64[np.ndarray, "joins"]
    """The other node."""
    distances: Float64[np.ndarray, "joins"]
    """Mutual reachability at which they join, metres."""


def linkage_tree(points: Float64[np.ndarray, "m 3"], weights: Int64[np.ndarray, "m"], min_samples: int) -> LinkageTree:
    """Return the single linkage of points whose distance is max(core of a, core of b, |a - b|).

    The core distance of a point is that within which it has `min_samples` others; a point of weight w stands for w
    points at one place. With fewer others than that, it is the distance of the farthest.

    Args:
        points: At least one, metres.
        weights: Points that each stands for, at least 1.
        min_samples: At least 1.
    """
    from pipeline.query.cluster_tree_kernels import boxes, link, spanning_tree, split

    if len(points) == 1:
        return LinkageTree(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    order = split(points)
    ordered = points[order]
    neighbours, cores = _neighbours(ordered, weights[order], min(min_samples, len(points) - 1), min_samples)
    first, second, lengths = spanning_tree(ordered, cores, neighbours, *boxes(ordered, cores))
    by_length = np.argsort(lengths, kind="stable")
    left, right = link(order[first[by_length]], order[second[by_length]])
    return LinkageTree(left, right, lengths[by_length])


def _neighbours(
    points: Float64[np.ndarray, "m 3"], weights: Int64[np.ndarray, "m"], count: int, min_samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest `count` points of each, int32, and the core distances."""
    from scipy.spatial import cKDTree

    # The points come in the order of a k-d tree already; without balancing, equal points do not slow the build down.
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    neighbours, cores = np.empty((len(points), count), np.int32), np.empty(len(points))
    for start in range(0, len(points), QUERIED):
        part = slice(start, start + QUERIED)
        distances, places = map(np.asarray, tree.query(points[part], count + 1))
        # A point is among its own nearest, at distance 0, but behind others at the same place.
        neighbours[part] = places[:, 1:]
        near = np.cumsum(weights[places], axis=1) > min_samples
        last = np.where(near[:, -1], near.argmax(axis=1), count)
        cores[part] = distances[np.arange(len(distances)), last]
    return neighbours, cores
