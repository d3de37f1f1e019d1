"""Rows of a question that every method fills in the same way, from its answer, arms and stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int32

from pipeline.query.savings import Saved
from pipeline.query.stopwatch import StageTime
from pipeline.tasks.decision import ARMS, Arm
from pipeline.tasks.marks import Mark
from pipeline.tasks.scoring import RegionScore
from pipeline.tasks.task_answer import TaskAnswer
from schemas.answers import AnswerRow, ArmRow
from schemas.calls import CallRow, RegionRow, TimingRow
from schemas.clusterings import ClusteringRow
from schemas.evidence import CandidateRow, ClusterRow
from schemas.questions import Question

METHOD = "splatreasoner"
"""Name of this method in rows."""


@dataclass(frozen=True, slots=True)
class QuestionRows:
    """Every row of one question, by table. All but `calls` and `timings` are the same in every run."""

    answers: tuple[AnswerRow, ...]
    """Table `answers`: one row."""
    arms: tuple[ArmRow, ...]
    """Table `arms`: one row an arm."""
    clusterings: tuple[ClusteringRow, ...] = ()
    """Table `clusterings`."""
    clusters: tuple[ClusterRow, ...] = ()
    """Table `clusters`."""
    candidates: tuple[CandidateRow, ...] = ()
    """Table `candidates`."""
    regions: tuple[RegionRow, ...] = ()
    """Table `regions`."""
    calls: tuple[CallRow, ...] = ()
    """Table `calls`."""
    timings: tuple[TimingRow, ...] = ()
    """Table `timings`."""


@dataclass(frozen=True, slots=True)
class Found:
    """What a question's answer was found in."""

    evidence: tuple[str, ...] = ()
    """Evidence categories, most useful first."""
    activated: int = 0
    """Gaussians that take part."""
    clusters: int = 0
    """Clusters or objects kept."""
    clusters_found: int = 0
    """Those before a cap."""


@dataclass(frozen=True, slots=True)
class Grounded:
    """Regions of one arm and their score."""

    regions: tuple[Int32[np.ndarray, "_"], ...]
    """Gaussians of each predicted instance."""
    score: RegionScore
    """How well they fit the targets."""
    rule: str = ""
    """Name of the rule that cut them; empty where none did."""


def answer_row(
    question: Question,
    method: str,
    result: TaskAnswer,
    found: Found,
    *,
    model: str,
    frames: int = 0,
    arm: str = "",
    saved: Sequence[Saved] = (),
) -> AnswerRow:
    """Return the row of table `answers`.

    Args:
        question: The query.
        method: Who answered.
        result: How it ended.
        found: What it was found in.
        model: Who was asked, from `models_named`.
        frames: Views given to the model.
        arm: What verification chose.
        saved: Calls not made.
    """
    return AnswerRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=method,
        question=question.question,
        reference=question.answer,
        evidence=found.evidence,
        activated=found.activated,
        clusters=found.clusters,
        clusters_found=found.clusters_found,
        status=result.status,
        reason=result.reason,
        answer=result.text,
        arm=arm,
        frames=frames,
        model=model,
        calls_saved=sum(entry.calls for entry in saved),
        saved=tuple(str(entry) for entry in saved),
    )


def arm_row(
    question: Question, method: str, arm: Arm, views: tuple[str, ...] = (), grounded: Grounded | None = None
) -> ArmRow:
    """Return an arm's row of table `arms`.

    Args:
        question: The query.
        method: Who answered.
        arm: How the arm answered.
        views: Candidate ids of the views given to the model, in image order.
        grounded: Its regions; None where it grounds nothing or did not answer.
    """
    targets = None if question.task == "eqa" or question.target_ids is None else len(question.target_ids)
    row = ArmRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=method,
        arm=arm.name,
        status=arm.result.status,
        reason=arm.result.reason,
        answer=arm.result.text,
        views=views,
        chosen=arm.result.chosen,
        frames=len(views),
        mark=arm.mark.mark,
        mark_reason=arm.mark.reason,
        predicted=None,
        targets=targets,
        iou=None,
        region_gaussians=None,
    )
    if grounded is None:
        return row
    covered = np.unique(np.concatenate([np.empty(0, np.int32), *grounded.regions]))
    return replace(
        row,
        predicted=len(grounded.regions),
        iou=grounded.score.iou,
        region_gaussians=len(covered),
        pair_ious=grounded.score.pair_ious,
        region=grounded.rule,
    )


def failed_rows(
    question: Question,
    error: Exception,
    calls: tuple[CallRow, ...] = (),
    *,
    method: str = METHOD,
    arms: Sequence[str] = ARMS,
) -> QuestionRows:
    """Return the rows of a question that ended in an error: a reason, never nothing.

    Args:
        question: The query.
        error: What went wrong.
        calls: Calls made before it.
        method: Who failed.
        arms: Its arms.
    """
    reason = f"{type(error).__name__}: {error}"
    result, mark = TaskAnswer("failed", reason, "", ()), Mark(None, f"failed: {reason}")
    return QuestionRows(
        (answer_row(question, method, result, Found(), model=models_named(calls)),),
        tuple(arm_row(question, method, Arm(name, result, (), mark)) for name in arms),
        calls=calls,
    )


def timing_rows(question: Question, times: Sequence[StageTime]) -> tuple[TimingRow, ...]:
    """Return the rows of a question's stages; those of work done once a scene name no question."""
    return tuple(
        TimingRow(
            "" if time.whole_scene else question.question_id, question.scene, time.stage, time.seconds, time.count
        )
        for time in times
    )


def models_named(calls: Sequence[CallRow]) -> str:
    """Return one name where all stages used the same model, else "stage=model" pairs; empty when nothing was asked."""
    by_stage: dict[str, str] = {}
    for call in calls:
        by_stage[call.stage] = call.model
    names = set(by_stage.values())
    return names.pop() if len(names) == 1 else ", ".join(f"{stage}={name}" for stage, name in sorted(by_stage.items()))
