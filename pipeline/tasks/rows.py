"""Grounding, scores and the rows of every table, from a question's proposal and decision. CPU only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from pipeline.config import MethodConfig
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import ARMS, Arm, Decision
from pipeline.tasks.grounding import Grounder, Instance, ShownView, standing_for
from pipeline.tasks.proposal import Proposal
from pipeline.tasks.scoring import score_regions, targets_of
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
class _Grounded:
    """Regions of one arm and their score."""

    instances: tuple[Instance, ...]
    predicted: int | None
    targets: int | None
    iou: float | None
    pair_ious: tuple[float, ...] | None = None
    rule: str = ""

    @property
    def size(self) -> int | None:
        if self.predicted is None:
            return None
        return len(np.unique(np.concatenate([np.empty(0, np.int32), *(found.gaussians for found in self.instances)])))


_NOT_GROUNDED = _Grounded((), None, None, None)


def conclude(
    context: SceneContext,
    question: Question,
    evidence: Evidence,
    proposal: Proposal,
    decision: Decision,
    config: MethodConfig,
) -> QuestionRows:
    """Return all rows of a question.

    Ground-truth instances are read here, for the IoU and for the quality of clusters, and nowhere before.

    Args:
        context: The scene's caches.
        question: The query.
        evidence: Its categories.
        proposal: Its candidate views.
        decision: What the models said.
        config: The method's.
    """
    watch = Stopwatch()
    grounds = question.task != "eqa"
    with watch.stage("ground", len(decision.arms) if grounds else 0):
        truth = targets_of(context, question) if grounds else None
        grounder = Grounder(context, proposal.activated, [group.ids for group in proposal.seen], config)
        grounded = [
            _ground(context, question, proposal, arm, decision.choices, grounder, truth, config)
            if grounds
            else _NOT_GROUNDED
            for arm in decision.arms
        ]
    with watch.stage("cluster_quality", len(proposal.categories)):
        clusterings = _clustering_rows(context, question, evidence, config)
    calls = evidence.calls + decision.calls
    times = (StageTime("evidence", evidence.seconds, len(evidence.calls)), *proposal.times, *decision.times)
    return QuestionRows(
        answers=(_answer_row(question, proposal, decision, calls),),
        arms=tuple(
            _arm_row(question, proposal, arm, result) for arm, result in zip(decision.arms, grounded, strict=True)
        ),
        clusterings=clusterings,
        clusters=_cluster_rows(question, proposal, decision),
        candidates=_candidate_rows(question, proposal, decision),
        regions=tuple(
            RegionRow(
                question.question_id,
                question.scene,
                arm.name,
                number,
                instance.view,
                tuple(instance.gaussians.tolist()),
                result.rule,
            )
            for arm, result in zip(decision.arms, grounded, strict=True)
            for number, instance in enumerate(result.instances)
        ),
        calls=calls,
        timings=timing_rows(question, (*times, *watch.times())),
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
    targets = None if question.target_ids is None or question.task == "eqa" else len(question.target_ids)
    answer = AnswerRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=method,
        question=question.question,
        reference=question.answer,
        evidence=(),
        activated=0,
        clusters=0,
        clusters_found=0,
        status="failed",
        reason=reason,
        answer="",
        arm="",
        frames=0,
        model=models_named(calls),
    )
    rows = tuple(
        ArmRow(
            question_id=question.question_id,
            scene=question.scene,
            task=question.task,
            category=question.category,
            method=method,
            arm=name,
            status="failed",
            reason=reason,
            answer="",
            views=(),
            chosen=(),
            frames=0,
            mark=None,
            mark_reason=f"failed: {reason}",
            predicted=None,
            targets=targets,
            iou=None,
            region_gaussians=None,
        )
        for name in arms
    )
    return QuestionRows((answer,), rows, calls=calls)


def _ground(
    context: SceneContext,
    question: Question,
    proposal: Proposal,
    arm: Arm,
    choices: Sequence[int | None],
    grounder: Grounder,
    truth: tuple[Int32[np.ndarray, "_"], ...] | None,
    config: MethodConfig,
) -> _Grounded:
    """Cut the arm's regions out of G_act and score them; an arm that did not answer is not scored."""
    targets = None if question.target_ids is None else len(question.target_ids)
    if arm.result.status != "answered":
        return _Grounded((), None, targets, None)
    groups = proposal.seen
    owned = standing_for([[c.picture for c in group.candidates] for group in groups], choices, arm.pictures)
    shown = []
    for picture in (arm.pictures[position] for position in arm.result.chosen):
        candidate = proposal.candidate_of(picture)
        shown.append(ShownView(candidate.id, candidate.camera, owned[picture]))
    instances = grounder.instances(shown, config.grounding)
    regions = [instance.gaussians for instance in instances]
    score = score_regions(context, question, regions, truth, config.grounding.weighting)
    return _Grounded(instances, len(instances), targets, score.iou, score.pair_ious, config.grounding.region)


def _answer_row(question: Question, proposal: Proposal, decision: Decision, calls: Sequence[CallRow]) -> AnswerRow:
    final = decision.arms[-1]
    return AnswerRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=METHOD,
        question=question.question,
        reference=question.answer,
        evidence=proposal.categories,
        activated=len(proposal.activated),
        clusters=len(proposal.seen),
        clusters_found=proposal.clusters_found,
        status=final.result.status,
        reason=final.result.reason,
        answer=final.result.text,
        arm=decision.stands,
        frames=len(final.pictures),
        model=models_named(calls),
        calls_saved=sum(saved.calls for saved in decision.saved),
        saved=tuple(str(saved) for saved in decision.saved),
    )


def _arm_row(question: Question, proposal: Proposal, arm: Arm, grounded: _Grounded) -> ArmRow:
    return ArmRow(
        question_id=question.question_id,
        scene=question.scene,
        task=question.task,
        category=question.category,
        method=METHOD,
        arm=arm.name,
        status=arm.result.status,
        reason=arm.result.reason,
        answer=arm.result.text,
        views=tuple(proposal.candidate_of(picture).id for picture in arm.pictures),
        chosen=arm.result.chosen,
        frames=len(arm.pictures),
        mark=arm.mark.mark,
        mark_reason=arm.mark.reason,
        predicted=grounded.predicted,
        targets=grounded.targets,
        iou=grounded.iou,
        region_gaussians=grounded.size,
        pair_ious=grounded.pair_ious,
        region=grounded.rule,
    )


def _clustering_rows(
    context: SceneContext, question: Question, evidence: Evidence, config: MethodConfig
) -> tuple[ClusteringRow, ...]:
    """One row for each category that was clustered; a question without evidence clustered nothing."""
    rows = []
    for category in evidence.categories if evidence.status == "answered" else ():
        measured, clusters = context.measured_clusters(category, config), context.clusters(category, config)
        activated, quality = len(context.activation(category, config.activation).ids), measured.quality
        truth = quality.ari is not None
        rows.append(
            ClusteringRow(
                question_id=question.question_id,
                scene=question.scene,
                category=category,
                activated=activated,
                epsilon_m=measured.epsilon_m,
                clusters=len(clusters),
                dropped=activated - sum(map(len, clusters)),
                known=quality.points,
                instances=quality.instances if truth else None,
                ari=quality.ari,
                over_split=quality.over_split if truth else None,
                under_split=quality.under_split if truth else None,
                matched=quality.matched if truth else None,
            )
        )
    return tuple(rows)


def _cluster_rows(question: Question, proposal: Proposal, decision: Decision) -> tuple[ClusterRow, ...]:
    choices = dict(zip((group.cluster for group in proposal.seen), decision.choices, strict=False))
    rows = []
    for group in proposal.groups:
        choice = choices.get(group.cluster)
        rows.append(
            ClusterRow(
                question_id=question.question_id,
                scene=question.scene,
                cluster=group.cluster,
                category=group.category,
                gaussians=group.size,
                centre=group.centre,
                initial_view=group.initial_view,
                visibility=group.visibility,
                visible=group.visible,
                final="" if choice is None else group.candidates[choice].id,
            )
        )
    return tuple(rows)


def _candidate_rows(question: Question, proposal: Proposal, decision: Decision) -> tuple[CandidateRow, ...]:
    choices = dict(zip((group.cluster for group in proposal.seen), decision.choices, strict=False))
    answers = dict(enumerate(decision.view_answers))
    return tuple(
        CandidateRow(
            question_id=question.question_id,
            scene=question.scene,
            cluster=group.cluster,
            candidate=candidate.id,
            move=candidate.move,
            world_to_camera=tuple(candidate.camera.world_to_camera.ravel().tolist()),
            requested_m=candidate.requested_m,
            moved_m=candidate.moved_m,
            visibility=candidate.quality.visibility,
            area=candidate.quality.area,
            centring=candidate.quality.centring,
            truncation=candidate.quality.truncation,
            touches_border=candidate.quality.touches_border,
            new_gaussians=candidate.quality.new_gaussians,
            unobserved=candidate.quality.unobserved,
            floaters=candidate.quality.floaters,
            source=candidate.source,
            answer=answers.get(candidate.picture),
            chosen=choices.get(group.cluster) == position,
        )
        for group in proposal.seen
        for position, candidate in enumerate(group.candidates)
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
