"""Every baseline on a generated apartment with the offline model: from question to rows."""

from __future__ import annotations

import asyncio
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest

from pipeline.baselines.config import (
    BlindConfig,
    CategoryFieldConfig,
    FrameCaptionsConfig,
    MemorySnapshotsConfig,
    MultiFrameConfig,
    SceneGraphConfig,
    VoxelCaptionsConfig,
)
from pipeline.baselines.registry import answer_question, steps_of
from pipeline.config import MethodConfig
from pipeline.models.clients import make_caller
from pipeline.models.config import ModelConfig
from pipeline.scene.procedural import build_apartment
from pipeline.scene.scene import Scene
from pipeline.scene.text_embeddings import TextEmbeddings
from pipeline.tasks import method
from pipeline.tasks.method import QuestionRows, SceneContext
from schemas.questions import Question
from schemas.tables import TABLES

EQA = (
    BlindConfig(),
    VoxelCaptionsConfig(),
    FrameCaptionsConfig(frames=6),
    SceneGraphConfig(),
    MultiFrameConfig(),
    MemorySnapshotsConfig(),
)
KINDS = [config.kind for config in EQA]


def _embedded(scene: Scene) -> Scene:
    """The scene with a perfect feature per category, and canonical phrases that resemble none."""
    names = scene.semantics.vocabulary
    vectors = np.eye(len(names) + 1, dtype=np.float32)
    features = np.where(scene.semantics.category[:, None] >= 0, vectors[scene.semantics.category], 0.0)
    phrases = [phrase for phrase in ("object", "things", "stuff", "texture") if phrase not in names]
    texts = TextEmbeddings((*names, *phrases), vectors[[*range(len(names)), *[-1] * len(phrases)]])
    semantics = dataclasses.replace(scene.semantics, embedding=features.astype(np.float32))
    return dataclasses.replace(scene, semantics=semantics, texts=texts)


@pytest.fixture(scope="module")
def flat() -> tuple[Scene, tuple[Question, ...]]:
    built = build_apartment(3, rooms=2, gaussians=12_000, views=16, width=160, height=120)
    couch = next(item for item in built.objects if item.category == "couch")

    def eqa(number: int, text: str, answer: str) -> Question:
        return Question(f"q{number}", built.scene.name, "eqa", text, answer, category="a")

    questions = (
        eqa(0, "What color is the couch?", couch.color.capitalize()),
        eqa(1, "Is there a couch?", "Yes"),
        Question("q2", built.scene.name, "ground_one", "the couch", target_ids=(couch.instance,)),
    )
    return _embedded(built.scene), questions


@pytest.fixture(scope="module")
def asked(flat: tuple[Scene, tuple[Question, ...]]) -> dict[str, list[QuestionRows]]:
    scene, questions = flat
    context, caller = SceneContext(scene), make_caller(ModelConfig(), None)

    async def run(config: Any) -> list[QuestionRows]:
        return [await answer_question(context, question, caller, config) for question in questions]

    return {config.kind: asyncio.run(run(config)) for config in (*EQA, CategoryFieldConfig())}


@pytest.mark.parametrize("kind", [*KINDS, "category_field"])
def test_rows_are_those_of_the_tables_with_one_arm_and_the_kinds_name(
    asked: dict[str, list[QuestionRows]], kind: str
) -> None:
    for rows in asked[kind]:
        for name, spec in TABLES.items():
            assert all(type(row) is spec.record for row in getattr(rows, name))
        assert [(arm.arm, arm.method) for arm in rows.arms] == [("final", kind)]
        assert [(row.method, row.arm) for row in rows.answers] == [(kind, "")]
        answer, arm = rows.answers[0], rows.arms[0]
        assert (answer.status, answer.reason, answer.answer, answer.frames) == (
            *(arm.status, arm.reason, arm.answer, arm.frames),
        )
        assert pickle.loads(pickle.dumps(rows)) == rows


@pytest.mark.parametrize("kind", KINDS)
def test_questions_in_words_are_answered_and_marked(asked: dict[str, list[QuestionRows]], kind: str) -> None:
    for rows in asked[kind][:2]:
        assert rows.answers[0].status == "answered", rows.answers[0].reason
        assert rows.arms[0].mark in (1, 2, 3, 4, 5)
        assert rows.calls[-1].stage == "judge"
        assert rows.answers[0].model == "symbolic"


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("blind", "multi_frame")])
def test_what_sees_the_couch_knows_its_colour(asked: dict[str, list[QuestionRows]], kind: str) -> None:
    assert asked[kind][0].arms[0].mark >= 4, asked[kind][0].answers[0].answer
    assert asked[kind][1].arms[0].mark == 5


@pytest.mark.parametrize(
    ("kind", "frames", "stages"),
    [
        ("blind", 0, {"answer": 1, "judge": 1}),
        ("voxel_captions", 0, {"answer": 1, "judge": 1}),
        ("frame_captions", 0, {"caption": 6, "answer": 1, "judge": 1}),
        ("multi_frame", 3, {"answer": 1, "judge": 1}),
        ("memory_snapshots", None, {"evidence": 1, "answer": 1, "judge": 1}),
    ],
)
def test_frames_and_calls_are_the_methods_own(
    asked: dict[str, list[QuestionRows]], kind: str, frames: int | None, stages: dict[str, int]
) -> None:
    rows = asked[kind][0]
    found = [call.stage for call in rows.calls]
    assert {stage: found.count(stage) for stage in found} == stages
    assert len(rows.arms[0].views) == rows.arms[0].frames
    assert rows.arms[0].frames == frames if frames is not None else rows.arms[0].frames >= 1


def test_a_scene_graph_describes_each_of_its_objects_once(asked: dict[str, list[QuestionRows]]) -> None:
    rows = asked["scene_graph_captions"][0]
    captions = [call for call in rows.calls if call.stage == "caption"]
    assert len(captions) == rows.answers[0].clusters > 5
    assert len({call.subject for call in captions}) == len(captions)
    assert sum("couch" in call.reply for call in captions) >= 1


def test_memory_snapshots_show_few_views_that_hold_the_evidence(
    asked: dict[str, list[QuestionRows]], flat: tuple[Scene, tuple[Question, ...]]
) -> None:
    scene, _ = flat
    rows = asked["memory_snapshots"][0]
    assert "couch" in rows.answers[0].evidence
    assert 1 <= rows.arms[0].frames <= rows.answers[0].clusters < len(scene.views)


@pytest.mark.parametrize("kind", KINDS)
def test_what_answers_in_words_skips_grounding_and_says_so(asked: dict[str, list[QuestionRows]], kind: str) -> None:
    rows = asked[kind][2]
    assert (rows.answers[0].status, rows.answers[0].reason) == ("skipped", f"{kind} only answers in words")
    assert (rows.arms[0].iou, rows.arms[0].predicted, rows.calls) == (None, None, ())


def test_a_perfect_category_field_finds_the_only_couch(asked: dict[str, list[QuestionRows]]) -> None:
    words, _, grounded = asked["category_field"]
    assert (words.answers[0].status, words.answers[0].reason) == ("skipped", "category_field only grounds in 3D")
    assert grounded.arms[0].iou == pytest.approx(1.0)


def test_a_second_run_gives_the_same_rows(
    asked: dict[str, list[QuestionRows]], flat: tuple[Scene, tuple[Question, ...]]
) -> None:
    scene, questions = flat
    context, caller = SceneContext(scene), make_caller(ModelConfig(), None)
    for config in (MemorySnapshotsConfig(), VoxelCaptionsConfig()):
        again = asyncio.run(answer_question(context, questions[0], caller, config))
        first = asked[config.kind][0]
        assert (again.answers, again.arms) == (first.answers, first.arms)


@pytest.mark.parametrize("config", [BlindConfig(), VoxelCaptionsConfig(), CategoryFieldConfig()])
def test_what_needs_no_picture_renders_nothing_and_reads_no_index(
    flat: tuple[Scene, tuple[Question, ...]], config: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, questions = flat

    def refuse(*_: Any) -> None:
        raise AssertionError("asked for a render")

    monkeypatch.setattr(SceneContext, "pictures", refuse)
    monkeypatch.setattr(SceneContext, "index", refuse)
    context, caller = SceneContext(scene), make_caller(ModelConfig(), None)
    for question in questions:
        asyncio.run(answer_question(context, question, caller, config))
    assert "gaussians" not in vars(context)
    assert steps_of(config).visibility(config) is None


def test_the_papers_method_keeps_its_steps() -> None:
    steps = steps_of(MethodConfig())
    assert (steps.find_evidence, steps.propose, steps.decide, steps.conclude) == (
        *(method.find_evidence, method.propose, method.decide, method.conclude),
    )
    assert steps.visibility(MethodConfig()) == MethodConfig().visibility
