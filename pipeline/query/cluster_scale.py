"""Distances of clustering from the density of the points themselves, so that they fit any scale and any splat count."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

EPSILON_CORES = 2.5
"""Derived epsilon, in core distances of the sparser points (measured in docs/clustering.md)."""

SPARSER = 0.75
"""Quantile of the core distances: the half-sparse parts of an object must hold together, stray points not count."""

JOIN_EPSILONS = 1.5
"""Derived distance at which noise joins a cluster, in epsilons."""

SAMPLED = 4096
"""Most points whose core distance is taken, evenly spread over the order of the points."""


def derived_epsilon(points: Float64[np.ndarray, "n 3"], min_samples: int) -> float:
    """Return the distance under which clusters are not split, from the spacing of the points, metres.

    It grows with the points: twice the size, twice the distance. Fewer than two points give 0.

    Args:
        points: Points of one category, metres.
        min_samples: Neighbours within a core distance.
    """
    if len(points) < 2:
        return 0.0
    from scipy.spatial import cKDTree

    sampled = points[:: -(-len(points) // SAMPLED)]
    neighbour = min(min_samples, len(points) - 1) + 1
    cores, _ = cKDTree(points, balanced_tree=False, compact_nodes=False).query(sampled, [neighbour])
    return EPSILON_CORES * float(np.quantile(cores, SPARSER))
