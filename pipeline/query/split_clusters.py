"""Clusters taken apart where only long steps hold them together: objects that stand side by side count one by one."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int32

from pipeline.query.linked_parts import linked_parts

PART = 0.15
"""Share of a cluster's Gaussians from which a part that nothing links to the rest is an object, not a few strays."""


def split_cluster(
    cluster: Int32[np.ndarray, "n"], means: Float[np.ndarray, "M 3"], step_m: float, fewest: int
) -> tuple[Int32[np.ndarray, "_"], ...]:
    """Return the objects a cluster is made of: its parts that no short step links, or itself where one is left.

    What is in no large part goes to the nearest one: no Gaussian is lost.

    Args:
        cluster: Sorted indices.
        means: Centres of all Gaussians, metres.
        step_m: Parts are linked where steps no longer than this lead from one to the other, metres.
        fewest: Least Gaussians of a part.

    Returns:
        Sorted indices of each, in the order of their first Gaussians.
    """
    from scipy.spatial import cKDTree

    points = np.asarray(means[cluster], np.float64)
    links = linked_parts(points, step_m)
    objects = np.flatnonzero(np.bincount(links) >= max(fewest, PART * len(cluster)))
    if len(objects) < 2:
        return (cluster,)
    large = np.flatnonzero(np.isin(links, objects))
    owner = links[large[np.asarray(cKDTree(points[large]).query(points)[1])]]
    return tuple(cluster[owner == number] for number in dict.fromkeys(owner.tolist()))
