"""From the views that were said to show a target to predicted instances (paper 3.4; supplement B.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Int32

from pipeline.config import MethodConfig
from pipeline.geometry import Camera
from pipeline.query.visibility import fitted_to
from pipeline.render import render
from pipeline.tasks.context import SceneContext
from pipeline.tasks.region import LOOKING, Activated, GroundingConfig, Sight, TaskView, region_of

T = TypeVar("T", int, str)


@dataclass(frozen=True, slots=True)
class ShownView:
    """A view that was said to show a target."""

    id: str
    """Candidate id."""
    camera: Camera
    """Lens at its recorded size, and pose."""
    own: tuple[int, ...]
    """Clusters it stands for, from `standing_for`."""


@dataclass(frozen=True, slots=True)
class Instance:
    """A predicted instance."""

    view: str
    """Candidate id of the view that grounds it."""
    gaussians: Int32[np.ndarray, "_"]
    """Its Gaussians, sorted."""


def standing_for(
    candidates: Sequence[Sequence[T]], chosen: Sequence[int | None], shown: Sequence[T]
) -> dict[T, tuple[int, ...]]:
    """Return the clusters that each view shown to the model stands for.

    A cluster's view is its final one where that was shown, else its initial one. A view that is no cluster's stands
    for all that have it among their candidates.

    Args:
        candidates: Candidate views of each cluster, the initial one first.
        chosen: Position of each cluster's final view; None where it was not readable.
        shown: Distinct views the model was shown.
    """
    own: dict[T, list[int]] = {view: [] for view in shown}
    for number, (views, choice) in enumerate(zip(candidates, chosen, strict=True)):
        final = None if choice is None else views[choice]
        view = final if final is not None and final in own else views[0]
        if view in own:
            own[view].append(number)
    return {
        view: tuple(numbers or (n for n, views in enumerate(candidates) if view in views))
        for view, numbers in own.items()
    }


class Grounder:
    """Cuts the regions of one question. A view is rendered when a rule looks at it, and once.

    Args:
        context: The scene's caches.
        activated: G_act, sorted.
        clusters: Clusters with candidate views, largest visible size first.
        config: The method's; size and near plane of its pictures are those of the sights.
    """

    def __init__(
        self,
        context: SceneContext,
        activated: Int32[np.ndarray, "n"],
        clusters: Sequence[Int32[np.ndarray, "_"]],
        config: MethodConfig,
    ) -> None:
        self._context, self._config = context, config
        self.activated = activated
        """G_act, sorted."""
        means = context.scene.gaussians.means
        self._found = Activated(activated, means, tuple(clusters), config.clustering.min_samples)
        self._sights: dict[str, Sight] = {}

    def instances(self, shown: Sequence[ShownView], config: GroundingConfig) -> tuple[Instance, ...]:
        """Return the predicted instances of the views that were said to show a target, in their order.

        Args:
            shown: Those views; none is possible.
            config: Region rule, and what is one instance.
        """
        found = []
        for view in shown:
            own = tuple(self._found.clusters[number] for number in view.own)
            sight = self._sight(view) if config.region in LOOKING else None
            parts = [(cluster,) for cluster in own] if config.instances == "clusters" else [own]
            for part in parts:
                gaussians = region_of(TaskView(view.camera, part, sight), self._found, config)
                found.append(Instance(view.id, gaussians))
        return tuple(found)

    def _sight(self, view: ShownView) -> Sight:
        if view.id not in self._sights:
            images = self._config.images
            camera = fitted_to(view.camera, images.long_side)
            image = render(self._context.gaussians, camera, ("depth", "dominant"), near=images.near_m)
            assert image.depth is not None
            assert image.dominant is not None
            self._sights[view.id] = Sight(camera, image.depth, image.dominant)
        return self._sights[view.id]
