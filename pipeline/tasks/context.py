"""What the questions of one scene share in one process: prepared Gaussians, visibility, clusters and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int32

from pipeline.config import MethodConfig
from pipeline.metrics.volume import Weighting, gaussian_weights
from pipeline.query.activate import Activation, ActivationConfig, TextEncoder, activate
from pipeline.query.candidates import ImageConfig, PictureBook
from pipeline.query.cluster import ClusterConfig, cluster_ids
from pipeline.query.initial_views import InitialView, initial_views
from pipeline.query.perturb import Move, NovelViewConfig
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
    """

    def __init__(self, scene: Scene, encoder: TextEncoder | None = None) -> None:
        self.scene = scene
        self._encoder = scene.texts if encoder is None else encoder
        self._activations: dict[tuple[str, ActivationConfig], Activation] = {}
        self._clusters: dict[tuple[str, ActivationConfig, ClusterConfig], tuple[Int32[np.ndarray, "_"], ...]] = {}
        self._found: dict[tuple[object, ...], tuple[FoundCluster, ...]] = {}
        self._indices: dict[VisibilityConfig, VisibilityIndex] = {}
        self._books: dict[ImageConfig, PictureBook] = {}
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

    def index(self, config: VisibilityConfig) -> VisibilityIndex:
        """Return the visibility index; it renders views when it is asked for counts, or by `build`."""
        if config not in self._indices:
            cameras = [view.camera for view in self.scene.views]
            self._indices[config] = VisibilityIndex(self.gaussians, cameras, config)
        return self._indices[config]

    def found_clusters(self, category: str, config: MethodConfig) -> tuple[FoundCluster, ...]:
        """Return the clusters of a category with their centres and initial views."""
        key = (category, config.activation, config.clustering, config.visibility)
        if key not in self._found:
            clusters = self.clusters(category, config)
            views = initial_views(self.index(config.visibility).counts(clusters))
            means = self.scene.gaussians.means
            self._found[key] = tuple(
                FoundCluster(category, ids, means[ids].mean(axis=0, dtype=np.float64), view)
                for ids, view in zip(clusters, views, strict=True)
            )
        return self._found[key]

    def pictures(self, config: ImageConfig) -> PictureBook:
        """Return the pictures of this scene."""
        if config not in self._books:
            self._books[config] = PictureBook(self.scene, self.gaussians, config)
        return self._books[config]

    def free_distances(self, view: int, config: NovelViewConfig) -> dict[Move, float]:
        """Return the probed free distances around a recorded view, to be filled by `novel_poses`."""
        return self._free.setdefault((view, config), {})

    def weights(self, weighting: Weighting) -> Float[np.ndarray, "M"]:
        """Return the IoU weight of every Gaussian."""
        if weighting not in self._weights:
            gaussians = self.scene.gaussians
            self._weights[weighting] = gaussian_weights(gaussians.log_scales, gaussians.opacity_logits, weighting)
        return self._weights[weighting]
