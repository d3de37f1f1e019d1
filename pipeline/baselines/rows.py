"""The rows of a baseline's question: the same tables and scores as the paper's method, with one arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.baselines.material import Material
from pipeline.metrics.volume import Weighting
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.tasks import rows as tasks_rows
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Decision
from pipeline.tasks.rows import Found, Grounded, QuestionRows, answer_row, arm_row, models_named, timing_rows
from pipeline.tasks.scoring import score_regions, targets_of
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
        found = _grounded(context, question, material, config) if grounded else None
    calls = evidence.calls + decision.calls
    times = (StageTime("evidence", evidence.seconds, len(evidence.calls)), *material.times, *decision.times)
    return QuestionRows(
        answers=(
            answer_row(
                question,
                config.kind,
                arm.result,
                Found(material.categories, material.activated, material.objects, material.objects),
                model=_models(material, calls),
                frames=len(arm.pictures),
            ),
        ),
        arms=(arm_row(question, config.kind, arm, tuple(material.names[p] for p in arm.pictures), found),),
        regions=tuple(
            RegionRow(question.question_id, question.scene, ARM, number, "", tuple(sorted(region.tolist())))
            for number, region in enumerate(material.regions if grounded else ())
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


def _grounded(context: SceneContext, question: Question, material: Material, config: Any) -> Grounded:
    weighting: Weighting = config.weighting
    truth = targets_of(context, question)
    return Grounded(material.regions, score_regions(context, question, material.regions, truth, weighting))
