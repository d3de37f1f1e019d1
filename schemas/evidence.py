"""Tables `clusters` and `candidates`: the regions found for a question and the views considered for them."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.table import Added, TableSpec

UNMEASURED = float("nan")
"""Measures of a view in parts of version 1; touches_border and new_gaussians are False and 0 there."""


@dataclass(frozen=True, slots=True)
class ClusterRow:
    """Table `clusters`: one row a question and cluster."""

    question_id: str
    """Question."""
    scene: str
    """Scene."""
    cluster: int
    """Cluster number l in this question, 0-based, by visible size."""
    category: str
    """Category it was clustered in."""
    gaussians: int
    """|G_cluster|."""
    centre: tuple[float, float, float]
    """Mean of its centres, metres."""
    initial_view: str
    """Recorded view with the highest score; empty when no view sees it."""
    visibility: float
    """S_vis of that view, 0 to 1."""
    visible: int
    """|G_vis| in that view."""
    final: str
    """Candidate id the judge chose."""


@dataclass(frozen=True, slots=True)
class CandidateRow:
    """Table `candidates`: one row a question, cluster and candidate view."""

    question_id: str
    """Question."""
    scene: str
    """Scene."""
    cluster: int
    """Cluster number."""
    candidate: str
    """Candidate id: the recorded view's name, or "<view>/<cluster>/<move>" for a novel one."""
    move: str
    """initial, left, right, forward, backward, ..., or explore_1, explore_2, ..."""
    world_to_camera: tuple[float, ...]
    """Pose, 12 numbers row by row, metres."""
    requested_m: float
    """Length of the move asked for, metres."""
    moved_m: float
    """Length of the move made; shorter when a surface was in the way."""
    visibility: float
    """S_vis of the cluster from here at the pictures' size, 0 to 1."""
    area: float
    """Share of the image's pixels whose dominant Gaussian is in the cluster, 0 to 1."""
    centring: float
    """Distance of those pixels' centroid from the image's centre: 0 there, 1 in a corner or without pixels."""
    truncation: float
    """Share of the cluster's centres outside the image or behind it, whether or not anything hides them."""
    touches_border: bool
    """Whether those pixels reach the border of the image."""
    new_gaussians: int
    """Gaussians of the cluster visible here and not in the initial view."""
    unobserved: float | None
    """Share of pixels that are less than half opaque or whose surface no recorded view saw; null when unknown."""
    floaters: float | None
    """Share of pixels whose surface one recorded view alone saw; null when unknown."""
    source: str
    """photo or render: what the model was shown."""
    answer: str | None
    """The model's answer from this view alone; null when it was not asked."""
    chosen: bool
    """The judge's choice for this cluster."""


CLUSTERS = TableSpec(
    name="clusters",
    version=1,
    record=ClusterRow,
    key=("question_id", "cluster"),
    columns={
        "question_id": "string",
        "scene": "string",
        "cluster": "int32",
        "category": "string",
        "gaussians": "int64",
        "centre": "list<float64>",
        "initial_view": "string",
        "visibility": "float64",
        "visible": "int64",
        "final": "string",
    },
)

CANDIDATES = TableSpec(
    name="candidates",
    version=2,
    record=CandidateRow,
    key=("question_id", "cluster", "candidate"),
    columns={
        "question_id": "string",
        "scene": "string",
        "cluster": "int32",
        "candidate": "string",
        "move": "string",
        "world_to_camera": "list<float64>",
        "requested_m": "float64",
        "moved_m": "float64",
        "visibility": "float64",
        "area": "float64",
        "centring": "float64",
        "truncation": "float64",
        "touches_border": "bool",
        "new_gaussians": "int64",
        "unobserved": "float64?",
        "floaters": "float64?",
        "source": "string",
        "answer": "string?",
        "chosen": "bool",
    },
    added={
        "area": Added(2, UNMEASURED),
        "centring": Added(2, UNMEASURED),
        "truncation": Added(2, UNMEASURED),
        "touches_border": Added(2, False),
        "new_gaussians": Added(2, 0),
        "unobserved": Added(2),
        "floaters": Added(2),
    },
)
