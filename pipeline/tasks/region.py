"""Which Gaussians a task view grounds: the frustum rule of the paper (3.4), and rules of ours by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, Float64, Int, Int32
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline.geometry import Camera, points_in_frustum
from pipeline.geometry.frustum import DEFAULT_FAR_M, DEFAULT_NEAR_M
from pipeline.metrics.volume import Weighting
from pipeline.query.cluster_scale import JOIN_EPSILONS, derived_epsilon
from pipeline.query.linked_parts import linked_parts

RegionRule = Literal["frustum", "visible", "depth", "cluster", "cluster_in_frustum", "prominent", "instance"]

LOOKING: frozenset[RegionRule] = frozenset({"visible", "depth", "prominent", "instance"})
"""Rules that read what the task view shows: it is rendered for them."""

OF_CLUSTERS: frozenset[RegionRule] = frozenset({"cluster", "cluster_in_frustum", "instance"})
"""Rules that tell the clusters of one view apart."""

PART = 0.1
"""Least share of an instance's visible Gaussians that makes a linked part belong to it: a few stray ones do not."""


class GroundingConfig(BaseModel):
    """How task views become regions, and how these are scored (paper 3.4; supplement B.4)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    region: RegionRule = Field(
        default="frustum",
        description="Activated Gaussians that a task view grounds (docs/grounding.md). frustum: centres in its "
        "frustum, hidden ones too (paper 3.4). visible: those it shows, and their near neighbours. depth: those of the "
        "frustum not far behind what it shows. cluster: the clusters it was chosen for. cluster_in_frustum: their "
        "part in the frustum. prominent: the cluster that fills most of it. instance: of its own clusters the one "
        "that fills most of it, with all that is linked to its visible part.",
    )
    instances: Literal["views", "clusters"] = Field(
        default="views",
        description="What is one predicted instance with many targets. views: each view said to show a target (paper, "
        "supplement B.4). clusters: each cluster that such a view was chosen for, so that objects that share a view "
        "count by themselves; needs region cluster, cluster_in_frustum or instance.",
    )
    near_m: float = Field(default=DEFAULT_NEAR_M, gt=0, description="Near plane of the frustum, metres.")
    far_m: float = Field(default=DEFAULT_FAR_M, gt=0, description="Far plane of the frustum, metres.")
    depth_tolerance_m: float = Field(
        default=1.0,
        ge=0,
        description="Region depth: how far behind the rendered depth a centre may lie, metres; about the depth of "
        "furniture, whose far side belongs to it.",
    )
    weighting: Weighting = Field(
        default="percentile", description="Weights of the IoU: the paper's, or LightGaussian's."
    )

    @model_validator(mode="after")
    def _clusters_are_told_apart(self) -> GroundingConfig:
        if self.instances == "clusters" and self.region not in OF_CLUSTERS:
            raise ValueError(
                f"instances: clusters needs region {', '.join(sorted(OF_CLUSTERS))}: {self.region} does not tell the "
                "clusters of a view apart"
            )
        return self


@dataclass(frozen=True, slots=True)
class Sight:
    """What a task view shows, at the size the models see it."""

    camera: Camera
    """The view's lens at that size, and its pose."""
    depth: Float32[np.ndarray, "H W"]
    """Rendered z-depth, metres; 0 where there is nothing."""
    dominant: Int32[np.ndarray, "H W"]
    """Gaussian with the largest weight of each pixel in the full scene; -1 for none."""

    def pixels(self, ids: Int[np.ndarray, "_"]) -> int:
        """Return how many pixels some Gaussians dominate."""
        return int(np.isin(self.dominant, ids).sum())


@dataclass(frozen=True, slots=True)
class TaskView:
    """A view that was said to show a target."""

    camera: Camera
    """Lens and pose."""
    own: tuple[Int32[np.ndarray, "_"], ...]
    """Clusters it was chosen for, sorted indices."""
    sight: Sight | None
    """What it shows; None where the rule does not look."""


@dataclass(frozen=True)
class Activated:
    """What a question activated."""

    ids: Int32[np.ndarray, "n"]
    """G_act, sorted."""
    means: Float[np.ndarray, "M 3"]
    """Centres of all Gaussians, metres."""
    clusters: tuple[Int32[np.ndarray, "_"], ...]
    """Clusters the question was shown views of, largest visible size first."""
    min_samples: int
    """Of the clustering."""

    @cached_property
    def centres(self) -> Float64[np.ndarray, "n 3"]:
        """Centres of G_act, metres."""
        return np.asarray(self.means[self.ids], np.float64)

    @cached_property
    def spacing_m(self) -> float:
        """Distance under which Gaussians of one object lie: the derived epsilon of G_act, metres."""
        return derived_epsilon(self.centres, self.min_samples)

    @cached_property
    def parts(self) -> Int[np.ndarray, "n"]:
        """Number of the linked part of each of G_act: steps of at most `spacing_m` lead from any to any of a part."""
        return linked_parts(self.centres, self.spacing_m)


def region_of(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """Return the Gaussians that a task view grounds, sorted.

    Args:
        view: The view; its sight for rules in `LOOKING`.
        found: What the question activated.
        config: The rule, its planes and tolerance.
    """
    return _RULES[config.region](view, found, config)


def frustum_region(
    camera: Camera, activated: Int[np.ndarray, "n"], means: Float[np.ndarray, "M 3"], config: GroundingConfig
) -> Int32[np.ndarray, "_"]:
    """Return the activated Gaussians whose centres lie in a task view's frustum, sorted; no occlusion test (paper 3.4).

    Args:
        camera: Task view.
        activated: G_act, sorted.
        means: Centres of all Gaussians, metres.
        config: Clipping planes.
    """
    inside = points_in_frustum(camera, means[activated], near_m=config.near_m, far_m=config.far_m)
    return activated[inside].astype(np.int32)


def _frustum(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """Paper 3.4."""
    return frustum_region(view.camera, found.ids, found.means, config)


def _visible(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """Those dominant at a pixel (as G_vis in the paper's 3.1), and those as near to one as noise joins a cluster.

    On a surface that is seen well, many a Gaussian is the heaviest of no pixel.
    """
    from scipy.spatial import cKDTree

    assert view.sight is not None
    shown = np.isin(found.ids, view.sight.dominant)
    if not shown.any():
        return np.empty(0, np.int32)
    reach = JOIN_EPSILONS * found.spacing_m
    distance, _ = cKDTree(found.centres[shown]).query(found.centres, distance_upper_bound=np.nextafter(reach, np.inf))
    return found.ids[np.isfinite(distance)]


def _depth(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """The frustum with a shadow test: no farther than the rendered depth of the centre's pixel and a tolerance."""
    assert view.sight is not None
    ids, camera = _frustum(view, found, config), view.sight.camera
    pixels, z = camera.project(found.means[ids])
    column, row = np.clip(pixels.astype(np.int64), 0, [camera.width - 1, camera.height - 1]).T
    surface = view.sight.depth[row, column]
    return ids[(surface == 0) | (z <= surface + config.depth_tolerance_m)]


def _cluster(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """The clusters of the paper's 3.1 that the view was chosen for."""
    return np.unique(np.concatenate([np.empty(0, np.int32), *view.own])).astype(np.int32)


def _cluster_in_frustum(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    return frustum_region(view.camera, _cluster(view, found, config), found.means, config)


def _prominent(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """The model answers from what it sees: of all the question's clusters that which dominates the most pixels."""
    return _filling(view, found.clusters)


def _instance(view: TaskView, found: Activated, config: GroundingConfig) -> Int32[np.ndarray, "_"]:
    """The own cluster that fills most of the view, without parts not shown, and with all that is linked to those shown.

    Nothing of it shown: the cluster as it is.
    """
    assert view.sight is not None
    cluster = _filling(view, view.own)
    seeds = np.isin(found.ids, np.intersect1d(cluster, view.sight.dominant))
    if not seeds.any():
        return cluster
    held = np.bincount(found.parts[seeds], minlength=int(found.parts.max()) + 1)
    return found.ids[(held >= PART * seeds.sum())[found.parts]]


def _filling(view: TaskView, clusters: tuple[Int32[np.ndarray, "_"], ...]) -> Int32[np.ndarray, "_"]:
    """The cluster with the most pixels, the first of equals; nothing of none."""
    assert view.sight is not None
    return max(clusters, key=view.sight.pixels, default=np.empty(0, np.int32))


_RULES: dict[RegionRule, Callable[[TaskView, Activated, GroundingConfig], Int32[np.ndarray, "_"]]] = {
    "frustum": _frustum,
    "visible": _visible,
    "depth": _depth,
    "cluster": _cluster,
    "cluster_in_frustum": _cluster_in_frustum,
    "prominent": _prominent,
    "instance": _instance,
}
