"""What a run found in its views, drawn again from the scene's files: clusters in every view, groundings, ground truth.

Clusters are found again as the run found them; one that does not come out the same is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int32, UInt8
from pydantic import ValidationError

from jobs.drawing.overlays import groups_image, overlay
from jobs.drawing.to_draw import ToDraw
from pipeline.config import MethodConfig
from pipeline.geometry import Camera
from pipeline.query.candidates import read_photo
from pipeline.query.visibility import fitted_to
from pipeline.render import color_image, render
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError

LARGE = 512
"""Longest side of a picture, pixels; views recorded smaller keep their size."""
SAME_CENTRE_M = 1e-4
"""Centres of a cluster found again differ by rounding alone."""
Ids = Int32[np.ndarray, "_"]


@dataclass(frozen=True, slots=True)
class DrawnView:
    """A candidate view and the clusters in it."""

    color: UInt8[np.ndarray, "H W 3"]
    """What the model was shown: the render, or the photograph where that was it."""
    overlay: bytes | None
    """PNG with the view's own cluster filled and the others outlined; None where none shows."""
    pixels: int
    """Pixels whose dominant Gaussian lies in the view's own cluster."""


@dataclass(frozen=True, slots=True)
class DrawnGrounding:
    """A view and the Gaussians that were grounded in it."""

    view: str
    """Name of the candidate."""
    color: UInt8[np.ndarray, "H W 3"]
    """Its render."""
    overlay: bytes
    """PNG with the instances filled and the ground truth outlined."""
    instances: Mapping[int, int]
    """Grounded Gaussians by instance."""
    truth: int | None
    """Pixels of the ground truth; None where it is unknown."""


def method_of(method: Mapping[str, Any]) -> MethodConfig | None:
    """Return a run's method; None for one that has no clusters.

    Raises:
        InputError: It is one of another version.
    """
    if method.get("kind") != "splatreasoner":
        return None
    try:
        return MethodConfig.model_validate(method)
    except ValidationError as error:
        raise InputError("the run's method", expected="fields of this version", found=str(error)) from error


def truth_mask(context: SceneContext, targets: Sequence[int]) -> Bool[np.ndarray, "_"] | None:
    """Return which Gaussians are targets, with a False for -1 at the end; None where that is unknown."""
    instance = context.scene.semantics.instance
    if instance is None or not targets:
        return None
    return np.append(np.isin(instance, targets), False)


class QuestionArtist:
    """Draws questions of one scene. Only `clusters` is not for several threads at once: the context keeps them.

    Args:
        context: The scene.
        method: The run's method; None for one that has no clusters.
        threads: Threads a render.
    """

    def __init__(self, context: SceneContext, method: MethodConfig | None, threads: int = 1) -> None:
        self._context, self._method, self._threads = context, method, threads
        self._near = (method or MethodConfig()).images.near_m
        self._views = {view.name: view for view in context.scene.views}
        self._gaussians = context.gaussians

    def clusters(self, question: ToDraw) -> dict[int, Ids]:
        """Return the Gaussians of the question's clusters by number; those that come out otherwise are left out."""
        means, found = self._context.scene.gaussians.means, {}
        for row in question.clusters if self._method else ():
            assert self._method is not None
            if row["category"] not in self._context.scene.semantics.vocabulary:
                continue
            for ids in self._context.clusters(row["category"], self._method):
                centre = means[ids].mean(axis=0, dtype=np.float64)
                if len(ids) == row["gaussians"] and np.abs(centre - np.array(row["centre"])).max() < SAME_CENTRE_M:
                    found[int(row["cluster"])] = ids
        return found

    def camera(self, question: ToDraw, row: Mapping[str, Any]) -> Camera | None:
        """Return the camera of a candidate: the lens of its cluster's initial view; None where that is no view here."""
        lens = next((c["initial_view"] for c in question.clusters if c["cluster"] == row["cluster"]), None)
        view = self._views.get(str(lens))
        pose = np.array(row["world_to_camera"], np.float64).reshape(3, 4)
        return None if view is None else view.camera.moved_to(pose)

    def view(
        self, question: ToDraw, row: Mapping[str, Any], groups: Mapping[int, Ids], long_side: int = LARGE
    ) -> DrawnView | None:
        """Return a candidate as the model saw it; None where its camera is unknown.

        Raises:
            InputError: Its photograph cannot be read.
        """
        camera, number = self.camera(question, row), int(row["cluster"])
        if camera is None:
            return None
        fitted = fitted_to(camera, long_side)
        seen = render(self._gaussians, fitted, ("color", "dominant"), near=self._near, threads=self._threads)
        assert seen.dominant is not None
        labels = groups_image(seen.dominant, _ordered(groups), len(self._gaussians))
        color, recorded = color_image(seen), self._views.get(str(row["candidate"]))
        if row["source"] == "photo" and recorded is not None and recorded.image is not None:
            color = read_photo(recorded.image, fitted.width, fitted.height)
        shown = overlay(labels, filled=number + 1) if labels.any() else None
        return DrawnView(color, shown, int((labels == number + 1).sum()))

    def grounded(self, question: ToDraw) -> Iterator[DrawnGrounding]:
        """Yield the views in which Gaussians were grounded."""
        poses = {str(row["candidate"]): row for row in question.candidates}
        truth = truth_mask(self._context, question.targets)
        for name in dict.fromkeys(str(row["view"]) for row in question.regions):
            if name in poses:
                camera = self.camera(question, poses[name])
            else:
                camera = self._views[name].camera if name in self._views else None
            if camera is None:
                continue
            fitted = fitted_to(camera, LARGE)
            seen = render(self._gaussians, fitted, ("color", "dominant"), near=self._near, threads=self._threads)
            assert seen.dominant is not None
            own = {
                int(row["instance"]): np.asarray(row["gaussians"], np.int32)
                for row in question.regions
                if row["view"] == name
            }
            labels = groups_image(seen.dominant, _ordered(own), len(self._gaussians))
            shown = None if truth is None else truth[seen.dominant]
            counts = {number: len(ids) for number, ids in own.items()}
            pixels = None if shown is None else int(shown.sum())
            yield DrawnGrounding(name, color_image(seen), overlay(labels, truth=shown), counts, pixels)


def _ordered(groups: Mapping[int, Ids]) -> list[Ids]:
    """Groups by number, empty ones where a number is missing."""
    return [groups.get(place, np.empty(0, np.int32)) for place in range(max(groups, default=-1) + 1)]
