"""Policies that were tried on the count of clusters and lost: merging and splitting by what views show of them.

Measured by benchmarks/counting.py; what is worth having is `method.clustering.split_epsilons`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.query.linked_parts import linked_parts
from pipeline.query.visibility import VisibilityCounts

SEEN = 0.1
"""Share of a cluster's Gaussians that a view must show to see it: a rim seen past a door does not count."""
PART_PIXELS = 0.15
"""Share of a cluster's pixels from which a part of its footprint may be an object: less is a leg or a handle."""


def merge_by_shared_views(
    clusters: Sequence[np.ndarray],
    means: np.ndarray,
    counts: VisibilityCounts,
    gap_m: float,
    shared: float,
) -> tuple[np.ndarray, ...]:
    """Return clusters where those that nearly touch and are seen together are one; larger first, then by lowest index.

    Merging is transitive: a row of pieces becomes one cluster.

    Args:
        clusters: L clusters of one category, sorted indices.
        means: Centres of all Gaussians, metres.
        counts: Of these clusters in the N recorded views.
        gap_m: Most distance between the nearest centres of two clusters, metres.
        shared: Least share, of the views that see either of the two, that see both, 0 to 1.
    """
    from scipy.sparse.csgraph import connected_components

    seen = counts.visible >= np.maximum(1, SEEN * counts.sizes[:, None])
    joined = np.zeros((len(clusters), len(clusters)), bool)
    points = [np.asarray(means[ids], np.float64) for ids in clusters]
    for first in range(len(clusters)):
        for second in range(first + 1, len(clusters)):
            together = _overlap(seen[first], seen[second]) >= shared
            joined[first, second] = together and _nearer(points[first], points[second], gap_m)
    owner = connected_components(joined, directed=False)[1]
    return in_order([np.concatenate([clusters[i] for i in np.flatnonzero(owner == o)]) for o in np.unique(owner)])


def split_by_footprint(
    cluster: np.ndarray,
    means: np.ndarray,
    dominant: np.ndarray,
    step_m: float,
) -> tuple[np.ndarray, ...]:
    """Return the objects that a view shows a cluster to be, larger first: itself, where it shows one.

    Parts of its footprint that do not touch propose a split. Something in front may have cut them, so only parts that
    are not linked in space either are objects; what the view does not show goes to the nearest of them.

    Args:
        cluster: Sorted indices.
        means: Centres of all Gaussians, metres.
        dominant: Dominance image of the view, of the full scene.
        step_m: Parts are linked where steps no longer than this lead from one to the other, metres.
    """
    from scipy.ndimage import label
    from scipy.spatial import cKDTree

    member = np.searchsorted(cluster, dominant).clip(max=len(cluster) - 1)
    mask = cluster[member] == dominant
    parts, count = label(mask)
    pixels = np.bincount(parts[mask], minlength=count + 1)
    kept = np.flatnonzero(pixels >= PART_PIXELS * mask.sum())
    kept = kept[kept > 0]
    if len(kept) < 2:
        return (cluster,)
    points = np.asarray(means[cluster], np.float64)
    links = linked_parts(points, step_m)
    seeds, owners = [], []
    for part in kept:
        shown = np.unique(member[parts == part])
        main = int(np.bincount(links[shown]).argmax())
        seeds.append(shown[links[shown] == main])
        owners.append(np.full(len(seeds[-1]), main))
    owner, seed = np.concatenate(owners), np.concatenate(seeds)
    objects = np.unique(owner)
    if len(objects) < 2:
        return (cluster,)
    nearest = owner[np.asarray(cKDTree(points[seed]).query(points)[1])]
    return in_order([cluster[nearest == number] for number in objects])


def in_order(clusters: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Return clusters as sorted indices, larger first, then by lowest index."""
    found = [np.sort(ids).astype(np.int32) for ids in clusters]
    return tuple(sorted(found, key=lambda ids: (-len(ids), int(ids[0]))))


def _overlap(first: np.ndarray, second: np.ndarray) -> float:
    either = int((first | second).sum())
    return int((first & second).sum()) / either if either else 0.0


def _nearer(first: np.ndarray, second: np.ndarray, gap_m: float) -> bool:
    from scipy.spatial import cKDTree

    apart = np.maximum(first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0))
    if apart.max() > gap_m:
        return False
    distance, _ = cKDTree(first).query(second, distance_upper_bound=np.nextafter(gap_m, np.inf))
    return bool(np.isfinite(distance).any())
