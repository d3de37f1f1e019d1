from __future__ import annotations

import asyncio
import dataclasses
import pickle

import numpy as np
import pytest

from pipeline.baselines.registry import answer_question
from pipeline.config import MethodConfig
from pipeline.metrics.iou import weighted_iou
from pipeline.scene.scene import Scene
from pipeline.tasks.method import (
    QuestionRows,
    SceneContext,
    conclude,
    decide,
    failed_rows,
    find_evidence,
    propose,
)
from schemas.errors import RetryError
from schemas.questions import Question, Task
from schemas.tables import TABLES
from tests.query.tiny import Scripted, caller_of, tiny_scene, without_instances

CONFIG = MethodConfig()


def _question(task: Task, targets: tuple[int, ...] | None = None) -> Question:
    return Question(
        "q1",
        "tiny",
        task,
        "what is there?",
        answer="a cup" if task == "eqa" else None,
        category="k",
        target_ids=targets,
    )


def _rows(
    question: Question, client: Scripted | None = None, scene: Scene | None = None, config: MethodConfig = CONFIG
) -> QuestionRows:
    context = SceneContext(scene or tiny_scene())
    return asyncio.run(answer_question(context, question, caller_of(client or Scripted({})), config))


def _same_every_run(rows: QuestionRows) -> tuple[object, ...]:
    return (rows.answers, rows.arms, rows.clusters, rows.candidates, rows.regions)


@pytest.mark.parametrize("task", ["eqa", "ground_one", "ground_many"])
def test_rows_repeat_exactly_and_survive_pickling(task: Task) -> None:
    question = _question(task, None if task == "eqa" else (0,))
    rows = _rows(question)
    assert _same_every_run(rows) == _same_every_run(_rows(question))
    assert pickle.loads(pickle.dumps(rows)) == rows


def test_steps_give_the_same_rows_when_their_values_pass_between_processes() -> None:
    question, caller = _question("ground_many", (0, 1)), caller_of(Scripted({}))
    context, other = SceneContext(tiny_scene()), SceneContext(tiny_scene())

    def sent(value: object) -> object:
        return pickle.loads(pickle.dumps(value))

    evidence = sent(asyncio.run(find_evidence(question, context.vocabulary, caller, CONFIG)))
    proposal = sent(propose(context, question, evidence, CONFIG))  # type: ignore[arg-type]
    decision = sent(asyncio.run(decide(question, proposal, caller, CONFIG)))  # type: ignore[arg-type]
    rows = conclude(other, question, evidence, proposal, decision, CONFIG)  # type: ignore[arg-type]
    assert _same_every_run(rows) == _same_every_run(_rows(question))


@pytest.mark.parametrize("task", ["eqa", "ground_one", "ground_many"])
def test_caches_and_earlier_questions_do_not_change_rows(task: Task) -> None:
    context, question = SceneContext(tiny_scene()), _question(task, None if task == "eqa" else (0,))
    small = MethodConfig.model_validate({"images": {"cache_mb": 0}})
    alone = _rows(question)
    for config in (CONFIG, small, CONFIG):
        other = _question("eqa" if task != "eqa" else "ground_many", None if task != "eqa" else ())
        asyncio.run(answer_question(context, other, caller_of(Scripted({})), config))
        rows = asyncio.run(answer_question(context, question, caller_of(Scripted({})), config))
        assert _same_every_run(rows) == _same_every_run(alone)


@pytest.mark.parametrize("task", ["eqa", "ground_one", "ground_many"])
def test_ground_truth_changes_scores_and_nothing_else(task: Task) -> None:
    question = _question(task, None if task == "eqa" else (0,))
    asked, asked_blind = Scripted({}), Scripted({})
    seen, blind = _rows(question, asked), _rows(question, asked_blind, without_instances(tiny_scene()))
    assert blind.answers == seen.answers
    assert blind.regions == seen.regions
    assert [dataclasses.replace(arm, iou=None, pair_ious=None) for arm in seen.arms] == list(blind.arms)
    assert [request.variables for request in asked.requests] == [request.variables for request in asked_blind.requests]
    if task != "eqa":
        assert all(arm.iou is not None for arm in seen.arms)


def test_answers_do_not_depend_on_the_reference_or_the_targets() -> None:
    with_answer = _rows(_question("eqa"))
    other = dataclasses.replace(_question("eqa"), answer="something else")
    without = _rows(other)
    assert [arm.answer for arm in with_answer.arms] == [arm.answer for arm in without.arms]
    first, second = (_rows(_question("ground_many", targets)) for targets in ((0,), (1, 2, 3)))
    assert first.regions == second.regions
    assert [arm.chosen for arm in first.arms] == [arm.chosen for arm in second.arms]


def test_answer_row_says_what_led_to_the_answer() -> None:
    answer = _rows(_question("eqa")).answers[0]
    assert (answer.evidence, answer.clusters, answer.clusters_found) == (("chair", "table", "wall"), 4, 5)
    assert answer.activated == len(tiny_scene().gaussians)
    assert (answer.status, answer.arm, answer.frames, answer.model) == ("answered", "final", 4, "script")
    assert answer.reference == "a cup"


def test_candidate_rows_agree_with_cluster_rows() -> None:
    rows = _rows(_question("eqa"))
    chosen = {row.cluster: row.candidate for row in rows.candidates if row.chosen}
    seen = [row for row in rows.clusters if row.initial_view]
    assert {row.cluster: row.final for row in seen} == chosen
    assert len(rows.candidates) == 5 * len(seen)
    unseen = [row for row in rows.clusters if not row.initial_view]
    assert [(row.final, row.visible, row.visibility) for row in unseen] == [("", 0, 0.0)]
    for row in rows.candidates:
        assert len(row.world_to_camera) == 12
        assert row.answer is not None
        assert row.source == "render"


def test_single_target_region_is_the_frustum_of_the_named_view_and_its_iou_by_hand() -> None:
    scene = tiny_scene()
    rows = _rows(_question("ground_one", (0,)))
    context = SceneContext(scene)
    truth = np.flatnonzero(scene.semantics.instance == 0)
    assert len(rows.regions) == 3
    for region, arm in zip(rows.regions, rows.arms, strict=True):
        assert region.arm == arm.arm
        assert region.view == arm.views[arm.chosen[0]]
        ids = np.array(region.gaussians)
        assert arm.iou == pytest.approx(weighted_iou(ids, truth, context.weights("percentile")))
        assert arm.region_gaussians == len(ids)
        assert (arm.predicted, arm.targets) == (1, 1)
        assert set(scene.semantics.category[ids]) == {0}


class TestNothingToLookAt:
    NONE = Scripted({"evidence": "none"})

    def test_eqa_is_skipped_with_a_reason_and_not_scored(self) -> None:
        rows = _rows(_question("eqa"), self.NONE)
        assert (rows.answers[0].status, rows.answers[0].frames) == ("skipped", 0)
        assert rows.answers[0].reason
        assert {arm.mark for arm in rows.arms} == {None}
        assert all(rows.answers[0].reason in arm.mark_reason for arm in rows.arms)
        assert len(rows.calls) == 1

    @pytest.mark.parametrize(("targets", "iou"), [((), 1.0), ((0, 1), 0.0), (None, None)])
    def test_multi_target_grounding_answers_that_nothing_is_there(
        self, targets: tuple[int, ...] | None, iou: float | None
    ) -> None:
        rows = _rows(_question("ground_many", targets), self.NONE)
        assert {(arm.status, arm.answer, arm.predicted, arm.iou) for arm in rows.arms} == {
            ("answered", "no target: no category of the scene is evidence for the question", 0, iou)
        }

    def test_single_target_grounding_is_skipped_and_not_scored(self) -> None:
        rows = _rows(_question("ground_one", (0,)), self.NONE)
        assert {(arm.status, arm.iou) for arm in rows.arms} == {("skipped", None)}

    def test_zero_target_needs_no_instances(self) -> None:
        rows = _rows(_question("ground_many", ()), self.NONE, without_instances(tiny_scene()))
        assert {arm.iou for arm in rows.arms} == {1.0}


def test_unreadable_evidence_is_unparsed_and_unscored() -> None:
    rows = _rows(_question("ground_many", ()), Scripted({"evidence": "hm"}))
    assert rows.answers[0].status == "unparsed"
    assert {(arm.status, arm.predicted, arm.iou) for arm in rows.arms} == {("unparsed", None, None)}


def test_zero_target_question_scores_by_whether_anything_was_predicted() -> None:
    no = "\n".join(f"Image {i}: No" for i in range(2))
    assert {arm.iou for arm in _rows(_question("ground_many", ()), Scripted({"answer_many": no})).arms} == {1.0}
    assert {arm.iou for arm in _rows(_question("ground_many", ())).arms} == {0.0}


def test_a_failed_question_has_a_row_in_every_arm_with_the_reason() -> None:
    rows = failed_rows(_question("ground_many", (0, 1)), RetryError("server is down"))
    assert rows.answers[0].status == "failed"
    assert "RetryError: server is down" in rows.answers[0].reason
    assert [(arm.arm, arm.status, arm.targets, arm.iou) for arm in rows.arms] == [
        (name, "failed", 2, None) for name in ("initial", "final", "verified")
    ]


@pytest.mark.parametrize("task", ["eqa", "ground_one", "ground_many"])
def test_every_row_is_of_its_tables_record(task: Task) -> None:
    for rows in (_rows(_question(task)), failed_rows(_question(task), ValueError("x"))):
        assert {field.name for field in dataclasses.fields(rows)} == set(TABLES)
        for name, spec in TABLES.items():
            assert all(type(row) is spec.record for row in getattr(rows, name))


def test_stages_are_timed_and_scene_work_is_marked_by_an_empty_question() -> None:
    timings = _rows(_question("ground_many", (0,))).timings
    stages = [row.stage for row in timings]
    for stage in (
        "evidence",
        "activate",
        "cluster",
        "index",
        "visibility",
        "perturb",
        "render",
        "view_answer",
        "choice",
    ):
        assert stages.count(stage) == 1
    assert {"answer", "verify", "ground"} <= set(stages)
    assert {row.stage for row in timings if row.question_id == ""} == {"index"}


def test_default_config_holds_the_papers_values() -> None:
    assert (CONFIG.evidence.k_eqa, CONFIG.evidence.k_grounding) == (3, 1)
    assert (CONFIG.activation.by, CONFIG.activation.threshold) == ("labels", 0.5)
    assert CONFIG.novel_views.count == 4
    assert CONFIG.images.initial_image == "render"
    assert CONFIG.grounding.weighting == "percentile"
    assert CONFIG.visibility.long_side is None
    assert CONFIG.clustering.voxel_m == 0


def test_config_survives_json_and_refuses_unknown_fields() -> None:
    assert MethodConfig.model_validate_json(CONFIG.model_dump_json()) == CONFIG
    with pytest.raises(ValueError, match="extra"):
        MethodConfig.model_validate({"novel_views": {"counts": 4}})
