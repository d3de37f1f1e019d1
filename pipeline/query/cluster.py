"""Clusters of activated Gaussians: instance-level candidates by HDBSCAN within one category (paper 3.1)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Int32, Int64
from pydantic import BaseModel, ConfigDict, Field

NOISE = -1
"""Label of a point in no cluster."""


class ClusterConfig(BaseModel):
    """HDBSCAN and what becomes of its leftovers (paper 3.1; supplement A.2: the distance is fixed per dataset)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    min_cluster_size: int = Field(
        default=20, ge=2, description="Fewest Gaussians of a cluster. A category with fewer becomes one cluster."
    )
    min_samples: int = Field(
        default=10, ge=1, description="Neighbours that make a point dense. Pinned: the library ties it to the size."
    )
    epsilon_m: float = Field(
        default=0.2,
        ge=0,
        description="Distance under which clusters are not split further, metres (cluster_selection_epsilon).",
    )
    noise_join_m: float = Field(
        default=0.3,
        ge=0,
        description="Noise this close to a clustered Gaussian joins its cluster, metres; noise farther off is dropped.",
    )
    voxel_m: float = Field(
        default=0.0,
        ge=0,
        description="Lossy: cluster one Gaussian per cube of this side, metres, and give the others its cluster. "
        "0 clusters every Gaussian.",
    )


def cluster_ids(
    ids: Int32[np.ndarray, "n"], means: Float[np.ndarray, "M 3"], config: ClusterConfig
) -> tuple[Int32[np.ndarray, "_"], ...]:
    """Return the clusters of one category's Gaussians, as sorted indices; larger first, then by lowest index.

    Args:
        ids: Activated Gaussians, sorted.
        means: Centres of all Gaussians, metres.
        config: Sizes and distances.
    """
    labels = cluster_points(np.asarray(means[ids], np.float64), config)
    groups = [ids[labels == label] for label in range(int(labels.max(initial=NOISE)) + 1)]
    return tuple(sorted(groups, key=lambda group: (-len(group), int(group[0]))))


def cluster_points(points: Float[np.ndarray, "n 3"], config: ClusterConfig) -> Int64[np.ndarray, "n"]:
    """Return a cluster number per point, -1 for dropped noise.

    Fewer than `min_cluster_size` points, or points that HDBSCAN calls noise altogether, are one cluster: a small or
    thin category is still evidence, and the paper asks for coarse groups only.
    """
    if not len(points):
        return np.empty(0, np.int64)
    chosen, member = _thin(points, config.voxel_m)
    labels = _hdbscan(points[chosen], config)
    if labels.max() == NOISE:
        return np.zeros(len(points), np.int64)
    labels = labels[member]
    return _join_noise(points, labels, config.noise_join_m)


def _hdbscan(points: Float[np.ndarray, "n 3"], config: ClusterConfig) -> Int64[np.ndarray, "n"]:
    if len(points) < max(config.min_cluster_size, 2):
        return np.full(len(points), NOISE, np.int64)
    # The import pulls in scikit-learn, more than a second: only a job that clusters pays it.
    from hdbscan import HDBSCAN

    # The exact spanning tree costs no more than the approximate one here. One job: the library's default starts
    # processes in every call, which takes seconds (docs/decisions/0003). Points are moved to their mean, since
    # distances lose digits far from the origin.
    model = HDBSCAN(
        min_cluster_size=config.min_cluster_size,
        min_samples=min(config.min_samples, len(points) - 1),
        cluster_selection_epsilon=config.epsilon_m,
        algorithm="boruvka_kdtree",
        approx_min_span_tree=False,
        core_dist_n_jobs=1,
        allow_single_cluster=True,
    )
    return np.asarray(model.fit_predict(points - points.mean(axis=0)), np.int64)


def _thin(points: Float[np.ndarray, "n 3"], voxel_m: float) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "n"]]:
    """Return one point of each occupied cube, and for each point which of those stands for it."""
    if voxel_m == 0:
        return np.arange(len(points)), np.arange(len(points))
    cells = np.floor((points - points.min(axis=0)) / voxel_m).astype(np.int64)
    _, first, member = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return first, member.reshape(-1)


def _join_noise(
    points: Float[np.ndarray, "n 3"], labels: Int64[np.ndarray, "n"], within_m: float
) -> Int64[np.ndarray, "n"]:
    noise, clustered = np.flatnonzero(labels == NOISE), np.flatnonzero(labels != NOISE)
    if not len(noise) or within_m == 0:
        return labels
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(points[clustered]).query(points[noise], distance_upper_bound=within_m)
    joined = labels.copy()
    near = np.isfinite(distance)
    joined[noise[near]] = labels[clustered[np.asarray(nearest)[near]]]
    return joined
