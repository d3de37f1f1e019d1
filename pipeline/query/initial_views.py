"""Initial views: for each cluster the recorded view that sees most of it (H_init, paper 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field

from pipeline.query.visibility import VisibilityCounts
from schemas.questions import Question


class InitialViewConfig(BaseModel):
    """How many clusters, and so frames, a question gets (paper 3.1; frames of its tables: 2.6 to 2.7)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

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
    """S_vis from there, 0 to 1."""
    visible: int
    """|G_vis| from there."""


def initial_views(counts: VisibilityCounts) -> tuple[InitialView, ...]:
    """Return the arg-max view of each cluster; ties go to the lowest view index.

    A cluster that no view sees (or a scene without views) gets None: it is reported, not lost.
    """
    chosen = []
    for row, size in zip(counts.visible, counts.sizes, strict=True):
        best = int(row.argmax()) if len(row) else 0
        visible = int(row[best]) if len(row) else 0
        chosen.append(InitialView(best if visible else None, visible / int(size), visible))
    return tuple(chosen)


def by_visible_size(views: tuple[InitialView, ...]) -> tuple[int, ...]:
    """Return cluster positions, most visible Gaussians first; ties keep their order, unseen clusters come last."""
    return tuple(sorted(range(len(views)), key=lambda position: -views[position].visible))
