"""Grounding, scores and the rows of every table, from a question's proposal and decision. CPU only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int32

from pipeline.config import MethodConfig
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Arm, Decision
from pipeline.tasks.grounding import Grounder, Instance, ShownView, standing_for
from pipeline.tasks.proposal import Proposal
from pipeline.tasks.rows import (
    METHOD,
    Found,
    Grounded,
    QuestionRows,
    answer_row,
    arm_row,
    models_named,
    timing_rows,
)
from pipeline.tasks.scoring import score_regions, targets_of
from schemas.calls import RegionRow
from schemas.clusterings import ClusteringRow
from schemas.evidence import CandidateRow, ClusterRow
from schemas.questions import Question


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
    watch, arms, final = Stopwatch(), decision.arms, decision.arms[-1]
    grounds = question.task != "eqa"
    with watch.stage("ground", len(arms) if grounds else 0):
        truth = targets_of(context, question) if grounds else None
        grounder = Grounder(context, proposal.activated, [group.ids for group in proposal.seen], config)
        found = [_instances(proposal, arm, decision.choices, grounder, config) if grounds else None for arm in arms]
        grounded = [None if each is None else _scored(context, question, each, truth, config) for each in found]
    with watch.stage("cluster_quality", len(proposal.categories)):
        clusterings = _clustering_rows(context, question, evidence, config)
    calls = evidence.calls + decision.calls
    times = (StageTime("evidence", evidence.seconds, len(evidence.calls)), *proposal.times, *decision.times)
    return QuestionRows(
        answers=(
            answer_row(
                question,
                METHOD,
                final.result,
                Found(proposal.categories, len(proposal.activated), len(proposal.seen), proposal.clusters_found),
                model=models_named(calls),
                frames=len(final.pictures),
                arm=decision.stands,
                saved=decision.saved,
            ),
        ),
        arms=tuple(
            arm_row(question, METHOD, arm, tuple(proposal.candidate_of(picture).id for picture in arm.pictures), result)
            for arm, result in zip(arms, grounded, strict=True)
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
                config.grounding.region,
            )
            for arm, instances in zip(arms, found, strict=True)
            for number, instance in enumerate(instances or ())
        ),
        calls=calls,
        timings=timing_rows(question, (*times, *watch.times())),
    )


def _instances(
    proposal: Proposal, arm: Arm, choices: Sequence[int | None], grounder: Grounder, config: MethodConfig
) -> tuple[Instance, ...] | None:
    """Cut the arm's regions out of G_act; None for an arm that did not answer."""
    if arm.result.status != "answered":
        return None
    owned = standing_for([[c.picture for c in group.candidates] for group in proposal.seen], choices, arm.pictures)
    shown = []
    for picture in (arm.pictures[position] for position in arm.result.chosen):
        candidate = proposal.candidate_of(picture)
        shown.append(ShownView(candidate.id, candidate.camera, owned[picture]))
    return grounder.instances(shown, config.grounding)


def _scored(
    context: SceneContext,
    question: Question,
    instances: Sequence[Instance],
    truth: tuple[Int32[np.ndarray, "_"], ...] | None,
    config: MethodConfig,
) -> Grounded:
    regions = tuple(instance.gaussians for instance in instances)
    score = score_regions(context, question, regions, truth, config.grounding.weighting)
    return Grounded(regions, score, config.grounding.region)


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
