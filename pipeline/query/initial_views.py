"""Initial views: for each cluster the recorded view that sees most of it (H_init, paper 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.query.visibility import VisibilityCounts
from schemas.questions import Question


class InitialViewConfig(BaseModel):
    """How views are scored, and how many clusters a question gets (paper 3.1; frames of its tables: 2.6 to 2.7)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    score: Literal["visibility", "volume"] = Field(
        default="visibility",
        description="What the best view shows most of: Gaussians, or their volume sx sy sz alpha "
        "(paper, ablation of the score function).",
    )
    max_clusters_eqa: int = Field(
        default=4, ge=1, description="Most clusters of a question to be answered in words, by visible size."
    )
    max_clusters_grounding: int = Field(
        default=12, ge=1, description="Most clusters of a grounding question, by visible size."
    )

    def max_clusters(self, question: Question) -> int:
        """Return the cap for this question."""
        return self.max_clusters_eqa if question.task == "eqa" else self.max_clusters_grounding


@dataclass(frozen=True, slots=True)
class InitialView:
    """The recorded view chosen for a cluster."""

    view: int | None
    """Index of the view; None when no view sees the cluster."""
    visibility: float
    """The score from there, 0 to 1: S_vis, or the share of the volume."""
    visible: int
    """|G_vis| from there."""


def initial_views(counts: VisibilityCounts) -> tuple[InitialView, ...]:
    """Return the arg-max view of each cluster; ties go to the lowest view index.

    A cluster that no view sees (or a scene without views) gets None: it is reported, not lost. By volume that holds
    also for a cluster of which only flat or transparent Gaussians are seen.
    """
    chosen = []
    for row, scores in zip(counts.visible, counts.scores, strict=True):
        best = int(scores.argmax()) if len(scores) else None
        if best is None or scores[best] == 0:
            chosen.append(InitialView(None, 0.0, 0))
        else:
            chosen.append(InitialView(best, float(scores[best]), int(row[best])))
    return tuple(chosen)


def by_visible_size(views: tuple[InitialView, ...]) -> tuple[int, ...]:
    """Return cluster positions, most visible Gaussians first; ties keep their order, unseen clusters come last."""
    return tuple(sorted(range(len(views)), key=lambda position: -views[position].visible))
