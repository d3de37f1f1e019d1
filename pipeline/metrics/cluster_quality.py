"""How well clusters meet ground-truth instances: adjusted Rand index, instances split and clusters that merge.

Only points with a known instance count. A point in no cluster stands alone: it is a cluster of one for the Rand index,
and in no cluster for the counts, so that evidence which was dropped costs something.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Int64

NONE = -1
"""Label of a point in no cluster, and of one whose instance is unknown."""

SHARE = 0.1
"""Least part of an instance's points that counts as a piece of it: a rim or a few stray points are none."""

MATCH_IOU = 0.5
"""A cluster is an instance's above this intersection over union; at most one can be."""


@dataclass(frozen=True, slots=True)
class ClusterQuality:
    """Clusters of one category against the instances among its points."""

    points: int
    """Points with a known instance."""
    instances: int
    """Distinct instances among them."""
    clusters: int
    """Distinct clusters among them."""
    dropped: int
    """Of the points, those in no cluster."""
    ari: float | None
    """Adjusted Rand index, -0.5 to 1; 1 for one point, None for none."""
    over_split: int
    """Instances with at least `SHARE` of their points in each of two or more clusters."""
    under_split: int
    """Clusters with at least `SHARE` of the points of each of two or more instances."""
    matched: int
    """Instances with a cluster of IoU above `MATCH_IOU`, counted in points."""


def cluster_quality(truth: Int[np.ndarray, "n"], predicted: Int[np.ndarray, "n"]) -> ClusterQuality:
    """Return how clusters meet instances; with no point of known instance all counts are 0 and `ari` is None.

    Args:
        truth: Instance id per point, -1 unknown.
        predicted: Cluster per point, -1 none.
    """
    known = truth != NONE
    truth, predicted = truth[known], predicted[known]
    kept = predicted != NONE
    overlap, instance_sizes, cluster_sizes = _overlap(truth, predicted)
    pieces = overlap >= SHARE * instance_sizes[:, None]
    pieces &= overlap > 0
    union = instance_sizes[:, None] + cluster_sizes[None, :] - overlap
    return ClusterQuality(
        points=len(truth),
        instances=len(instance_sizes),
        clusters=len(cluster_sizes),
        dropped=int((~kept).sum()),
        ari=adjusted_rand(truth, apart(predicted)) if len(truth) else None,
        over_split=int((pieces.sum(axis=1) > 1).sum()),
        under_split=int((pieces.sum(axis=0) > 1).sum()),
        matched=int((overlap > MATCH_IOU * union).any(axis=1).sum()),
    )


def adjusted_rand(first: Int[np.ndarray, "n"], second: Int[np.ndarray, "n"]) -> float:
    """Return the adjusted Rand index of two partitions (Hubert and Arabie 1985): 1 when equal, 0 as by chance.

    Two partitions of no point or of one are equal. So are two with every point in one part, or every point alone,
    where the formula has no value.

    Args:
        first: Part of each point, any numbers.
        second: Part of each point, any numbers.
    """
    _, rows = np.unique(first, return_inverse=True)
    _, columns = np.unique(second, return_inverse=True)
    _, joint = np.unique(rows.astype(np.int64) * (columns.max(initial=0) + 1) + columns, return_counts=True)
    together, in_first, in_second = _pairs(joint), _pairs(np.bincount(rows)), _pairs(np.bincount(columns))
    if together == in_first == in_second:
        return 1.0
    every = len(first) * (len(first) - 1) // 2
    # Python's integers: products of pair counts pass 64 bits from 100,000 points on.
    above = 2 * (together * every - in_first * in_second)
    return above / ((in_first + in_second) * every - 2 * in_first * in_second)


def apart(labels: Int[np.ndarray, "n"]) -> Int64[np.ndarray, "n"]:
    """Return labels where each point in no cluster has a number of its own."""
    alone = labels == NONE
    found = labels.astype(np.int64)
    found[alone] = labels.max(initial=NONE) + 1 + np.arange(int(alone.sum()))
    return found


def _pairs(sizes: Int[np.ndarray, "_"]) -> int:
    """Pairs of points inside parts of these sizes."""
    counts = sizes.astype(np.int64)
    return int((counts * (counts - 1) // 2).sum())


def _overlap(
    truth: Int[np.ndarray, "n"], predicted: Int[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "I C"], Float[np.ndarray, "I"], Float[np.ndarray, "C"]]:
    """Points that instances and clusters share, and the sizes of both."""
    kept = predicted != NONE
    names, rows = np.unique(truth, return_inverse=True)
    numbers, columns = np.unique(predicted[kept], return_inverse=True)
    shape = (len(names), len(numbers))
    flat = np.bincount(rows[kept] * max(shape[1], 1) + columns, minlength=shape[0] * shape[1])
    table = flat[: shape[0] * shape[1]].reshape(shape).astype(np.float64)
    return table, np.bincount(rows, minlength=shape[0]).astype(np.float64), table.sum(axis=0)
