"""Categories and instances of a scene from labelled points, distilled together so that they never contradict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from pipeline.construct.distillation.distill import DistillConfig, Distilled, distill
from pipeline.construct.distillation.labelled_points import LabelledPoints
from pipeline.scene import Gaussians
from pipeline.scene.semantics import UNLABELLED
from schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """What labelled points say of M Gaussians."""

    category: Int32[np.ndarray, "M"] | None
    """Index into the points' vocabulary, -1 unlabelled; None where the points have none."""
    instance: Int32[np.ndarray, "M"] | None
    """Instance id, -1 unlabelled; None where the points have none."""
    votes: Distilled
    """How clear the votes were; its labels number the pairs of instance and category."""


def ground_truth(
    gaussians: Gaussians, points: LabelledPoints, config: DistillConfig | None = None, *, threads: int = 1
) -> GroundTruth:
    """Return the category and the instance of every Gaussian (paper, supplement "Dataset Construction").

    Each pair of instance and category is one label, so a Gaussian has the category of its instance. A tie goes to the
    lower instance, then to the lower category.

    Args:
        gaussians: M Gaussians, in the points' coordinates.
        points: Labelled points.
        config: Which points count.
        threads: Chunks of Gaussians side by side.

    Raises:
        InputError: No Gaussian got a label: the points lie elsewhere, or have none.
    """
    columns = [points.instance, points.category]
    nothing = np.full(len(points.points), UNLABELLED, np.int32)
    pairs, pair = np.unique(
        np.stack([nothing if ids is None else ids for ids in columns], axis=1), axis=0, return_inverse=True
    )
    # The pair of two -1 sorts first, where there is one, and is no label.
    silent = int((pairs[0] == UNLABELLED).all())
    pairs = np.concatenate([np.full((1, 2), UNLABELLED, np.int32), pairs[silent:]])
    votes = distill(
        gaussians, points.points, pair.reshape(-1).astype(np.int32) - np.int32(silent), config, threads=threads
    )
    if (votes.label == UNLABELLED).all():
        found = f"none of {len(gaussians)}: other coordinates?"
        raise InputError("labelled points", expected="labels on some Gaussian", found=found)
    instance, category = (
        None if ids is None else np.ascontiguousarray(pairs[votes.label + 1, column])
        for column, ids in enumerate(columns)
    )
    return GroundTruth(category, instance, votes)
