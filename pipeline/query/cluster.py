"""Clusters of activated Gaussians: instance-level candidates by HDBSCAN within one category (paper 3.1)."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float, Float64, Int32, Int64
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline.query.cluster_scale import JOIN_EPSILONS, derived_epsilon
from pipeline.query.cluster_tree import linkage_tree
from pipeline.query.split_clusters import split_cluster

NOISE = -1
"""Label of a point in no cluster."""

MIXED = np.array([1.0, np.sqrt(2.0), np.pi])
"""Weights of x, y and z in a number that tells most places apart."""


class ClusterConfig(BaseModel):
    """HDBSCAN and what becomes of its leftovers (paper 3.1; supplement A.2: the distance is fixed per dataset)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    min_cluster_size: int = Field(
        default=20, ge=2, description="Fewest Gaussians of a cluster. A category with fewer becomes one cluster."
    )
    min_samples: int = Field(
        default=10, ge=1, description="Neighbours that make a point dense: those within its core distance."
    )
    epsilon_m: float | None = Field(
        default=None,
        ge=0,
        description="Distance under which clusters are not split further, metres (cluster_selection_epsilon). "
        "null: 2.5 times the upper quartile of the category's core distances.",
    )
    noise_join_m: float | None = Field(
        default=None,
        ge=0,
        description="Noise this close to a clustered Gaussian joins its cluster, metres; noise farther off is dropped. "
        "null: 1.5 times epsilon.",
    )
    voxel_m: float = Field(
        default=0.0,
        ge=0,
        description="Lossy: cluster the means of the Gaussians in each cube of this side, metres, and give all of them "
        "its cluster. 0 clusters every Gaussian.",
    )
    split_epsilons: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="A cluster is taken apart where only steps longer than this many epsilons hold parts together "
        "(at least 15 % of it and min_cluster_size each), so that neighbours count one by one; 0.6 is a good value, "
        "less splits objects (docs/grounding.md). 0 leaves the clusters of HDBSCAN.",
    )
    by: Literal["tree", "hdbscan"] = Field(
        default="tree",
        description="tree: our exact spanning tree, seconds for a million Gaussians. hdbscan: the package, the same "
        "clusters (docs/decisions/0005-clustering.md) at several times the cost.",
    )

    @model_validator(mode="after")
    def _package_knows_no_cubes(self) -> ClusterConfig:
        if self.by == "hdbscan" and self.voxel_m:
            raise ValueError("by: hdbscan counts every Gaussian: voxel_m must be 0")
        return self


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
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(int(labels.max(initial=NOISE)) + 2))
    groups = [ids[order[low:high]] for low, high in pairwise(bounds)]
    if config.split_epsilons:
        step_m = config.split_epsilons * (with_distances(means[ids], config).epsilon_m or 0.0)
        groups = [part for group in groups for part in split_cluster(group, means, step_m, config.min_cluster_size)]
    return tuple(sorted(groups, key=lambda group: (-len(group), int(group[0]))))


def with_distances(points: Float[np.ndarray, "n 3"], config: ClusterConfig) -> ClusterConfig:
    """Return the config with every distance in metres, as it applies to one category's points.

    Args:
        points: Centres of the category's Gaussians, metres.
        config: Sizes and distances.
    """
    epsilon, join = config.epsilon_m, config.noise_join_m
    if epsilon is None:
        epsilon = derived_epsilon(np.asarray(points, np.float64), config.min_samples)
    if join is None:
        join = JOIN_EPSILONS * epsilon
    return config.model_copy(update={"epsilon_m": epsilon, "noise_join_m": join})


def cluster_points(points: Float[np.ndarray, "n 3"], config: ClusterConfig) -> Int64[np.ndarray, "n"]:
    """Return a cluster number per point, -1 for dropped noise.

    Fewer than `min_cluster_size` points, or points that HDBSCAN calls noise altogether, are one cluster: a small or
    thin category is still evidence, and the paper asks for coarse groups only.

    Args:
        points: Centres of one category's Gaussians, metres.
        config: Sizes and distances.
    """
    if len(points) < config.min_cluster_size:
        return np.zeros(len(points), np.int64)
    exact = np.asarray(points, np.float64)
    config = with_distances(exact, config)
    labels = _by_package(exact, config) if config.by == "hdbscan" else _by_tree(exact, config)
    if labels.max() == NOISE:
        return np.zeros(len(points), np.int64)
    assert config.noise_join_m is not None
    return _join_noise(exact, labels, config.noise_join_m)


def _by_tree(points: Float64[np.ndarray, "n 3"], config: ClusterConfig) -> Int64[np.ndarray, "n"]:
    # The import compiles or loads kernels: only a job that clusters pays it.
    from pipeline.query.cluster_kernels import select_clusters

    chosen, weights, member = thin(points, config.voxel_m)
    # Distances lose digits far from the origin.
    tree = linkage_tree(chosen - chosen.mean(axis=0), weights, config.min_samples)
    labels = select_clusters(
        tree.left, tree.right, tree.distances, weights, config.min_cluster_size, config.epsilon_m, config.voxel_m
    )
    return labels[member]


def _by_package(points: Float64[np.ndarray, "n 3"], config: ClusterConfig) -> Int64[np.ndarray, "n"]:
    # The import pulls in scikit-learn, more than a second.
    from hdbscan import HDBSCAN

    assert config.epsilon_m is not None
    model = HDBSCAN(
        min_cluster_size=config.min_cluster_size,
        min_samples=min(config.min_samples, len(points) - 1),
        cluster_selection_epsilon=config.epsilon_m,
        algorithm="boruvka_kdtree",
        approx_min_span_tree=False,
        core_dist_n_jobs=1,  # the default starts processes in every call, which takes seconds
        allow_single_cluster=True,
    )
    return np.asarray(model.fit_predict(points - points.mean(axis=0)), np.int64)


def thin(
    points: Float64[np.ndarray, "n 3"], voxel_m: float
) -> tuple[Float64[np.ndarray, "m 3"], Int64[np.ndarray, "m"], Int64[np.ndarray, "n"]]:
    """Return the mean of the points in each occupied cube, how many they are, and for each point its cube.

    Cubes lie on a grid through the world's origin, whatever the points are.

    Args:
        points: Metres.
        voxel_m: Side of a cube. 0 keeps all points or, where a tenth of them share their place, one of each place:
            that changes no cluster, and searches among equal points take time quadratic in their number.
    """
    if voxel_m == 0 and len(np.unique(points @ MIXED)) > 0.9 * len(points):
        return points, np.ones(len(points), np.int64), np.arange(len(points))
    cells = np.floor(points / voxel_m) if voxel_m else points
    order = np.lexsort(cells.T)
    starts = np.concatenate([[True], (cells[order[1:]] != cells[order[:-1]]).any(axis=1)])
    member = np.empty(len(points), np.int64)
    member[order] = np.cumsum(starts) - 1
    weights = np.bincount(member)
    sums = [np.bincount(member, points[:, axis]) for axis in range(3)]
    return np.stack(sums, axis=1) / weights[:, None], weights, member


def _join_noise(
    points: Float64[np.ndarray, "n 3"], labels: Int64[np.ndarray, "n"], within_m: float
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
