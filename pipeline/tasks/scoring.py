"""Predicted regions against ground-truth instances, whatever method predicted them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from pipeline.metrics.instance_iou import instance_iou
from pipeline.metrics.iou import weighted_iou
from pipeline.metrics.volume import Weighting
from pipeline.tasks.context import SceneContext
from schemas.questions import Question


@dataclass(frozen=True, slots=True)
class RegionScore:
    """How well regions fit the targets."""

    iou: float | None
    """3D IoU, or instance-aware mIoU for several targets; None where the targets are unknown."""
    pair_ious: tuple[float, ...] | None
    """IoU of each assigned pair of prediction and target; None but for several targets."""


def targets_of(context: SceneContext, question: Question) -> tuple[Int32[np.ndarray, "_"], ...] | None:
    """Return the Gaussians of each target instance; None when they are unknown."""
    instance = context.scene.semantics.instance
    if question.target_ids is None or (question.target_ids and instance is None):
        return None
    return tuple(np.flatnonzero(instance == target).astype(np.int32) for target in question.target_ids)


def score_regions(
    context: SceneContext,
    question: Question,
    regions: Sequence[Int32[np.ndarray, "_"]],
    truth: Sequence[Int32[np.ndarray, "_"]] | None,
    weighting: Weighting,
) -> RegionScore:
    """Return the score of predicted regions (paper 4.1).

    Args:
        context: The scene's caches.
        question: The query; its task decides the metric.
        regions: One a predicted instance.
        truth: From `targets_of`.
        weighting: Weights of the Gaussians.
    """
    if truth is None:
        return RegionScore(None, None)
    weights = context.weights(weighting)
    if question.task == "ground_many":
        score = instance_iou(regions, truth, weights)
        return RegionScore(score.score, tuple(pair[2] for pair in score.pairs))
    nothing = np.empty(0, np.int32)
    return RegionScore(
        weighted_iou(np.concatenate([nothing, *regions]), np.concatenate([nothing, *truth]), weights), None
    )
