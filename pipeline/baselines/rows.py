"""The rows of a baseline's question: the same tables and scores as the paper's method, with one arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.baselines.material import Material
from pipeline.metrics.volume import Weighting
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.tasks import rows as tasks_rows
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Arm, Decision
from pipeline.tasks.rows import QuestionRows, models_named, timing_rows
from pipeline.tasks.scoring import RegionScore, score_regions, targets_of
from schemas.answers import AnswerRow, ArmRow
from schemas.calls import CallRow, RegionRow
from schemas.questions import Question

ARM = "final"
"""Name of the only arm."""


def conclude(
    context: SceneContext,
    question: Question,
    evidence: Evidence,
    material: Material,
    decision: Decision,
    config: Any,
) -> QuestionRows:
    """Return all rows of a question; ground-truth instances are read here alone, for the IoU.

    Args:
        context: The scene's caches.
        question: The query.
        evidence: Its categories.
        material: What was gathered.
        decision: What the models said.
        config: The baseline's; its kind is the rows' method.
    """
    watch, arm = Stopwatch(), decision.arms[0]
    grounded = question.task != "eqa" and arm.result.status == "answered"
    with watch.stage("ground", int(grounded)):
        score = RegionScore(None, None)
        if grounded:
            truth, weighting = targets_of(context, question), _weighting(config)
            score = score_regions(context, question, material.regions, truth, weighting)
    calls = evidence.calls + decision.calls
    times = (StageTime("evidence", evidence.seconds, len(evidence.calls)), *material.times, *decision.times)
    regions = material.regions if grounded else ()
    return QuestionRows(
        answers=(_answer_row(question, material, arm, config.kind, _models(material, calls)),),
        arms=(_arm_row(question, material, arm, score, config.kind, grounded),),
        regions=tuple(
            RegionRow(question.question_id, question.scene, ARM, number, "", tuple(sorted(region.tolist())))
            for number, region in enumerate(regions)
        ),
        calls=calls,
        timings=timing_rows(question, (*times, *watch.times())),
    )


def failed_rows(kind: str, question: Question, error: Exception, calls: tuple[CallRow, ...]) -> QuestionRows:
    """Return the rows of a question that ended in an error: a reason, never nothing.

    Args:
        kind: The baseline's.
        question: The query.
        error: What went wrong.
        calls: Calls made before it.
    """
    return tasks_rows.failed_rows(question, error, calls, method=kind, arms=(ARM,))


def _models(material: Material, calls: Sequence[CallRow]) -> str:
    return ", ".join(name for name in (models_named(calls), material.stand_in) if name)


def _weighting(config: Any) -> Weighting:
    weighting: Weighting = config.weighting
    return weighting


def _answer_row(question: Question, material: Material, arm: Arm, method: str, model: str) -> AnswerRow:
    return AnswerRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=method,
        question=question.question,
        reference=question.answer,
        evidence=material.categories,
        activated=material.activated,
        clusters=material.objects,
        clusters_found=material.objects,
        status=arm.result.status,
        reason=arm.result.reason,
        answer=arm.result.text,
        arm="",
        frames=len(arm.pictures),
        model=model,
    )


def _arm_row(
    question: Question, material: Material, arm: Arm, score: RegionScore, method: str, grounded: bool
) -> ArmRow:
    targets = None if question.task == "eqa" or question.target_ids is None else len(question.target_ids)
    covered = np.unique(np.concatenate([np.empty(0, np.int32), *material.regions]))
    return ArmRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=method,
        arm=ARM,
        status=arm.result.status,
        reason=arm.result.reason,
        answer=arm.result.text,
        views=tuple(material.names[picture] for picture in arm.pictures),
        chosen=arm.result.chosen,
        frames=len(arm.pictures),
        mark=arm.mark.mark,
        mark_reason=arm.mark.reason,
        predicted=len(material.regions) if grounded else None,
        targets=targets,
        iou=score.iou,
        region_gaussians=len(covered) if grounded else None,
        pair_ious=score.pair_ious,
    )
