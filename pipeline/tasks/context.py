"""What the questions of one scene share in one process: prepared Gaussians, visibility, clusters and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int32

from pipeline.config import MethodConfig
from pipeline.metrics.cluster_quality import ClusterQuality, cluster_quality
from pipeline.metrics.volume import Weighting, gaussian_weights, volumes
from pipeline.query.activate import Activation, ActivationConfig, TextEncoder, activate
from pipeline.query.candidates import ImageConfig, PictureBook
from pipeline.query.cluster import ClusterConfig, cluster_ids, with_distances
from pipeline.query.explore import Explorer
from pipeline.query.explore_config import ExploreConfig
from pipeline.query.initial_views import InitialView
from pipeline.query.perturb import Move, NovelViewConfig
from pipeline.query.view_bounds import ClusterInViews
from pipeline.query.view_quality import times_seen
from pipeline.query.view_search import best_of_top, best_views, builds_whole
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.render import PreparedGaussians, prepare
from pipeline.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class FoundCluster:
    """A cluster of one category and the recorded view that sees most of it."""

    category: str
    """Category it was clustered in."""
    ids: Int32[np.ndarray, "n"]
    """Sorted indices of its Gaussians."""
    centre: Float[np.ndarray, "3"]
    """Mean of their centres, metres."""
    initial: InitialView
    """Its initial view."""


@dataclass(frozen=True, slots=True)
class MeasuredClusters:
    """How the clusters of a category came about and how good they are."""

    epsilon_m: float
    """Distance under which they were not split, metres."""
    quality: ClusterQuality
    """Them against the ground-truth instances."""


def scene_vocabulary(scene: Scene) -> tuple[str, ...]:
    """Return the sorted names that evidence is chosen from: those some Gaussian carries.

    A scene with embeddings only has no labels to look at: its whole vocabulary is offered.
    """
    semantics = scene.semantics
    return semantics.present() if semantics.category is not None else tuple(sorted(semantics.vocabulary))


class SceneContext:
    """Caches of one scene. Nothing is computed before it is needed; a context built again gives the same results.

    Not for several threads at once. Configs are part of every key, so methods that differ may share a context.

    Args:
        scene: The scene.
        encoder: Text embeddings, for scenes searched by embedding; None takes those the scene brings.
        threads: Renders side by side; more than 1 pays where one question alone is under way.
    """

    def __init__(self, scene: Scene, encoder: TextEncoder | None = None, threads: int = 1) -> None:
        self.scene, self._threads = scene, threads
        self._encoder = scene.texts if encoder is None else encoder
        self._activations: dict[tuple[str, ActivationConfig], Activation] = {}
        self._clusters: dict[tuple[str, ActivationConfig, ClusterConfig], tuple[Int32[np.ndarray, "_"], ...]] = {}
        self._measured: dict[tuple[str, ActivationConfig, ClusterConfig], MeasuredClusters] = {}
        self._found: dict[tuple[object, ...], tuple[FoundCluster, ...]] = {}
        self._indices: dict[VisibilityConfig, VisibilityIndex] = {}
        self._targets: dict[tuple[object, ...], list[ClusterInViews]] = {}
        self._volume: Float[np.ndarray, "M"] | None = None
        self._books: dict[ImageConfig, PictureBook] = {}
        self._seen: dict[VisibilityConfig, Int32[np.ndarray, "M"]] = {}
        self._explorers: dict[tuple[ExploreConfig, VisibilityConfig], Explorer] = {}
        self._free: dict[tuple[int, NovelViewConfig], dict[Move, float]] = {}
        self._weights: dict[Weighting, Float[np.ndarray, "M"]] = {}

    @cached_property
    def vocabulary(self) -> tuple[str, ...]:
        """Names that evidence is chosen from."""
        return scene_vocabulary(self.scene)

    @cached_property
    def gaussians(self) -> PreparedGaussians:
        """The Gaussians prepared for rendering."""
        return prepare(self.scene.gaussians)

    def activation(self, category: str, config: ActivationConfig) -> Activation:
        """Return the Gaussians a category activates."""
        key = (category, config)
        if key not in self._activations:
            self._activations[key] = activate(self.scene.semantics, category, config, self._encoder)
        return self._activations[key]

    def clusters(self, category: str, config: MethodConfig) -> tuple[Int32[np.ndarray, "_"], ...]:
        """Return the clusters of a category, as sorted indices."""
        key = (category, config.activation, config.clustering)
        if key not in self._clusters:
            ids = self.activation(category, config.activation).ids
            self._clusters[key] = cluster_ids(ids, self.scene.gaussians.means, config.clustering)
        return self._clusters[key]

    def measured_clusters(self, category: str, config: MethodConfig) -> MeasuredClusters:
        """Return the clusters of a category against the ground-truth instances: for scores, never for the method."""
        key = (category, config.activation, config.clustering)
        if key not in self._measured:
            ids, instance = self.activation(category, config.activation).ids, self.scene.semantics.instance
            labels = np.full(len(ids), -1)
            for number, cluster in enumerate(self.clusters(category, config)):
                labels[np.searchsorted(ids, cluster)] = number
            truth = np.full(len(ids), -1) if instance is None else instance[ids]
            epsilon = with_distances(self.scene.gaussians.means[ids], config.clustering).epsilon_m
            assert epsilon is not None
            self._measured[key] = MeasuredClusters(epsilon, cluster_quality(truth, labels))
        return self._measured[key]

    def index(self, config: VisibilityConfig) -> VisibilityIndex:
        """Return the visibility index; nothing is rendered before it is asked for."""
        if config not in self._indices:
            cameras = [view.camera for view in self.scene.views]
            self._indices[config] = VisibilityIndex(self.gaussians, cameras, config)
        return self._indices[config]

    def found_clusters(self, category: str, config: MethodConfig) -> tuple[FoundCluster, ...]:
        """Return the clusters of a category with their centres and initial views."""
        key = self._view_key(category, config)
        if key not in self._found:
            clusters = self.clusters(category, config)
            views = self._initial_views(category, config)
            means = self.scene.gaussians.means
            self._found[key] = tuple(
                FoundCluster(category, ids, means[ids].mean(axis=0, dtype=np.float64), view)
                for ids, view in zip(clusters, views, strict=True)
            )
        return self._found[key]

    def builds_index(self, categories: Sequence[str], config: MethodConfig) -> bool:
        """Return whether the clusters of these categories need the whole visibility index, and it is not there yet.

        Where not, `found_clusters` renders what it takes to choose the same views.
        """
        index = self.index(config.visibility)
        if not index.missing or self._rescores(config):
            return index.missing > 0
        return builds_whole([target for category in categories for target in self._targets_of(category, config)])

    def _initial_views(self, category: str, config: MethodConfig) -> tuple[InitialView, ...]:
        targets = self._targets_of(category, config)
        self._targets.pop(self._view_key(category, config))  # they hold projections that are not needed again
        if not self._rescores(config):
            return best_views(targets)
        coarse = self.index(config.visibility).counts([target.ids for target in targets], self._volumes(config))
        return best_of_top(targets, coarse, config.visibility.exact_top)

    def _targets_of(self, category: str, config: MethodConfig) -> list[ClusterInViews]:
        """The clusters of a category in the views that decide."""
        key, visibility = self._view_key(category, config), config.visibility
        if key not in self._targets:
            if self._rescores(config):
                visibility = visibility.model_copy(update={"long_side": None, "exact_top": 0})
            index, volumes = self.index(visibility), self._volumes(config)
            clusters = self.clusters(category, config)
            self._targets[key] = [ClusterInViews(index, cluster, volumes) for cluster in clusters]
        return self._targets[key]

    def _rescores(self, config: MethodConfig) -> bool:
        """Whether a reduced pass only proposes views, which are scored again at full size."""
        return config.visibility.long_side is not None and config.visibility.exact_top > 0

    def _view_key(self, category: str, config: MethodConfig) -> tuple[object, ...]:
        return category, config.activation, config.clustering, config.visibility, config.initial_views.score

    def _volumes(self, config: MethodConfig) -> Float[np.ndarray, "M"] | None:
        """What the score counts instead of Gaussians."""
        if config.initial_views.score == "visibility":
            return None
        if self._volume is None:
            self._volume = volumes(self.scene.gaussians.log_scales, self.scene.gaussians.opacity_logits)
        return self._volume

    def pictures(self, config: ImageConfig) -> PictureBook:
        """Return the pictures of this scene."""
        if config not in self._books:
            self._books[config] = PictureBook(self.scene, self.gaussians, config, self._threads)
        return self._books[config]

    def times_seen(self, config: MethodConfig) -> Int32[np.ndarray, "M"] | None:
        """Return how many recorded views saw the place of each Gaussian.

        None unless every view is rendered in any case: what a row holds must not depend on which questions came
        before. A search for views needs it and renders them.
        """
        index = self.index(config.visibility)
        if config.novel_views.policy != "explore" and config.visibility.build != "all":
            return None
        if config.visibility not in self._seen:
            joined = index.joined()
            gaussians = np.repeat(np.arange(len(self.gaussians)), np.diff(joined.starts))
            self._seen[config.visibility] = times_seen(
                self.scene.gaussians.means, gaussians, joined.views.astype(np.int64)
            )
        return self._seen[config.visibility]

    def explorer(self, config: MethodConfig) -> Explorer:
        """Return the search for views of this scene; the policy must be `explore`."""
        novel = config.novel_views
        key = (novel.explore, config.visibility)
        if key not in self._explorers:
            seen = self.times_seen(config)
            assert seen is not None
            near_m = config.visibility.near_m
            explorer = Explorer(self.scene, self.gaussians, seen, novel.explore, near_m=near_m, threads=self._threads)
            self._explorers[key] = explorer
        return self._explorers[key]

    def free_distances(self, view: int, config: NovelViewConfig) -> dict[Move, float]:
        """Return the probed free distances around a recorded view, to be filled by `novel_poses`."""
        return self._free.setdefault((view, config), {})

    def weights(self, weighting: Weighting) -> Float[np.ndarray, "M"]:
        """Return the IoU weight of every Gaussian; 0 where the scene's ground truth is silent."""
        if weighting not in self._weights:
            gaussians, instance = self.scene.gaussians, self.scene.semantics.instance
            self._weights[weighting] = gaussian_weights(
                gaussians.log_scales, gaussians.opacity_logits, weighting, instance
            )
        return self._weights[weighting]
