"""Table `clusterings`: how each evidence category was clustered, and how that meets ground-truth instances."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.table import TableSpec


@dataclass(frozen=True, slots=True)
class ClusteringRow:
    """One row a question and evidence category. Nulls stand where no activated Gaussian has a known instance."""

    question_id: str
    """Question."""
    scene: str
    """Scene."""
    category: str
    """Evidence category that was clustered."""
    activated: int
    """Gaussians it activates."""
    epsilon_m: float
    """Distance under which clusters were not split, metres: the one asked for or the one derived."""
    clusters: int
    """Clusters found, before any cap."""
    dropped: int
    """Activated Gaussians in no cluster."""
    known: int
    """Activated Gaussians with a ground-truth instance; what follows is over these."""
    instances: int | None
    """Distinct instances among them."""
    ari: float | None
    """Adjusted Rand index of clusters and instances; a dropped Gaussian counts as a cluster of its own."""
    over_split: int | None
    """Instances with a tenth or more of their Gaussians in each of several clusters."""
    under_split: int | None
    """Clusters with a tenth or more of the Gaussians of each of several instances."""
    matched: int | None
    """Instances with a cluster of IoU above 0.5, counted in Gaussians."""


CLUSTERINGS = TableSpec(
    name="clusterings",
    version=1,
    record=ClusteringRow,
    key=("question_id", "category"),
    columns={
        "question_id": "string",
        "scene": "string",
        "category": "string",
        "activated": "int64",
        "epsilon_m": "float64",
        "clusters": "int64",
        "dropped": "int64",
        "known": "int64",
        "instances": "int64?",
        "ari": "float64?",
        "over_split": "int64?",
        "under_split": "int64?",
        "matched": "int64?",
    },
)
