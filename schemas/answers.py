"""Table `answers`: one row a question, the outcome and what led to it. Holds nothing that differs between runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from schemas.table import Added, TableSpec

Status = Literal["answered", "unparsed", "failed", "skipped"]
"""answered; unparsed: a reply stayed unreadable after re-asking; failed: an error; skipped: nothing to look at."""


@dataclass(frozen=True, slots=True)
class AnswerRow:
    """One question's outcome."""

    question_id: str
    """Question."""
    scene: str
    """Scene."""
    task: str
    """eqa, ground_one or ground_many."""
    category: str
    """Question type, for grouping."""
    method: str
    """Method that answered, "splatreasoner" or a baseline's name."""
    question: str
    """The query Q."""
    reference: str | None
    """Reference answer; null when unknown."""
    evidence: tuple[str, ...]
    """Evidence categories, most useful first (paper 3.1)."""
    activated: int
    """Gaussians in G_act."""
    clusters: int
    """L, clusters kept."""
    clusters_found: int
    """Clusters before the cap."""
    status: Status
    """How it ended."""
    reason: str
    """Why it is not answered; empty when it is."""
    answer: str
    """Final answer text."""
    arm: str
    """Arm that verification chose: initial, final or, over several clusters, mixed; empty with nothing to verify."""
    frames: int
    """Views given to the model for the final answer."""
    model: str
    """Models by stage, such as "symbolic"; symbolic is not a VLM and every row says so."""
    calls_saved: int = 0
    """Model calls not made, against asking everything (docs/decisions/0002)."""
    saved: tuple[str, ...] = ()
    """Those calls as "stage: reason: calls"."""


@dataclass(frozen=True, slots=True)
class ArmRow:
    """Table `arms`: one row a question and arm of the ablation (initial, final, verified)."""

    question_id: str
    """Question."""
    scene: str
    """Scene; intervals are clustered by it."""
    task: str
    """eqa, ground_one or ground_many."""
    category: str
    """Question type."""
    method: str
    """Method."""
    arm: str
    """initial: answered from the initial views; final: from the views the judge chose; verified: after verification."""
    status: Status
    """How this arm ended."""
    reason: str
    """Why it is not answered."""
    answer: str
    """Answer text."""
    views: tuple[str, ...]
    """Candidate ids of the views given to the model, in image order."""
    chosen: tuple[int, ...]
    """Image indices the model named (grounding)."""
    frames: int
    """Number of views given."""
    mark: int | None
    """LLM-Match mark 1 to 5, 0 for an empty answer; null when unscored."""
    mark_reason: str
    """Why it is unscored; empty when it is scored."""
    predicted: int | None
    """Instances predicted (grounding)."""
    targets: int | None
    """Ground-truth instances (grounding); null when unknown."""
    iou: float | None
    """3D IoU (ground_one) or instance-aware 3D mIoU of this question (ground_many), 0 to 1; null when unscored."""
    region_gaussians: int | None
    """Gaussians in the predicted region."""
    pair_ious: tuple[float, ...] | None = None
    """IoU of each instance assigned to a target (ground_many, scored); null elsewhere and in parts of version 1."""
    region: str = ""
    """Rule that cut the regions (grounding by views), such as frustum; frustum in parts before version 3."""


ANSWERS = TableSpec(
    name="answers",
    version=2,
    record=AnswerRow,
    key=("method", "question_id"),
    columns={
        "question_id": "string",
        "scene": "string",
        "task": "string",
        "category": "string",
        "method": "string",
        "question": "string",
        "reference": "string?",
        "evidence": "list<string>",
        "activated": "int64",
        "clusters": "int32",
        "clusters_found": "int32",
        "status": "string",
        "reason": "string",
        "answer": "string",
        "arm": "string",
        "frames": "int32",
        "model": "string",
        "calls_saved": "int32",
        "saved": "list<string>",
    },
    added={"calls_saved": Added(2, 0), "saved": Added(2, ())},
)

ARMS = TableSpec(
    name="arms",
    version=3,
    record=ArmRow,
    key=("method", "question_id", "arm"),
    columns={
        "question_id": "string",
        "scene": "string",
        "task": "string",
        "category": "string",
        "method": "string",
        "arm": "string",
        "status": "string",
        "reason": "string",
        "answer": "string",
        "views": "list<string>",
        "chosen": "list<int32>",
        "frames": "int32",
        "mark": "int32?",
        "mark_reason": "string",
        "predicted": "int32?",
        "targets": "int32?",
        "iou": "float64?",
        "region_gaussians": "int64?",
        "pair_ious": "list<float64>?",
        "region": "string",
    },
    added={"pair_ious": Added(2), "region": Added(3, "frustum")},
)
