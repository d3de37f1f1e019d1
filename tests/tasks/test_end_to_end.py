"""The whole method on a generated apartment with the offline model: every task, from question file to rows."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence

import pytest

from pipeline.baselines.registry import answer_question
from pipeline.config import MethodConfig
from pipeline.models.clients import make_caller
from pipeline.models.config import ModelConfig
from pipeline.scene.objects import SceneObject
from pipeline.scene.procedural import build_apartment
from pipeline.scene.scene import Scene
from pipeline.tasks.method import QuestionRows, SceneContext
from schemas.questions import Question, Task

Asked = tuple[Scene, tuple[Question, ...], list[QuestionRows]]


def _answer(scene: Scene, questions: Sequence[Question]) -> list[QuestionRows]:
    context, caller = SceneContext(scene), make_caller(ModelConfig(), None)

    async def run() -> list[QuestionRows]:
        return [await answer_question(context, question, caller, MethodConfig()) for question in questions]

    return asyncio.run(run())


def _questions(name: str, objects: Sequence[SceneObject]) -> tuple[Question, ...]:
    """Plain questions with known answers; the generator's own are tested with it."""
    counts = Counter(item.category for item in objects)
    alone = [item for item in objects if counts[item.category] == 1 and item.color][:6]
    several = sorted(category for category, count in counts.items() if 2 <= count <= 4)[:3]
    missing = next(word for word in ("piano", "ladder", "toaster") if word not in counts)
    made: list[Question] = []

    def add(task: Task, text: str, **known: object) -> None:
        made.append(Question(f"{name}-{len(made)}", name, task, text, category=task, **known))  # type: ignore[arg-type]

    for item in alone:
        add("eqa", f"What color is the {item.category}?", answer=item.color.capitalize())
        add("ground_one", f"Find the {item.category}", target_ids=(item.instance,))
    for category in several:
        targets = tuple(item.instance for item in objects if item.category == category)
        add("ground_many", f"All of the {category}s", target_ids=targets)
    add("ground_many", f"Find the {missing}", target_ids=())
    return tuple(made)


@pytest.fixture(scope="module")
def asked() -> Asked:
    built = build_apartment(3, rooms=2, gaussians=20_000, views=32, width=160, height=120)
    questions = _questions(built.scene.name, built.objects)
    return built.scene, questions, _answer(built.scene, questions)


def test_every_question_has_one_answer_and_three_arms(asked: Asked) -> None:
    _, questions, rows = asked
    assert len(questions) >= 10
    assert {question.task for question in questions} == {"eqa", "ground_one", "ground_many"}
    for question, row in zip(questions, rows, strict=True):
        assert [answer.question_id for answer in row.answers] == [question.question_id]
        assert [arm.arm for arm in row.arms] == ["initial", "final", "verified"]
        assert row.answers[0].status in ("answered", "skipped")
        assert (row.answers[0].reason == "") == (row.answers[0].status == "answered")


def test_most_questions_are_answered_and_scored_in_every_arm(asked: Asked) -> None:
    _, questions, rows = asked
    answered = [row for row in rows if row.answers[0].status == "answered"]
    assert len(answered) > 0.6 * len(questions)
    for row in answered:
        for arm in row.arms:
            if arm.task == "eqa":
                assert arm.mark in (1, 2, 3, 4, 5)
            else:
                assert arm.iou is not None
                assert 0.0 <= arm.iou <= 1.0


def test_some_answers_are_right(asked: Asked) -> None:
    _, _, rows = asked
    arms = [arm for row in rows for arm in row.arms]
    assert max(arm.mark or 0 for arm in arms if arm.task == "eqa") >= 4
    assert max(arm.iou or 0.0 for arm in arms if arm.task == "ground_one") > 0.25


def test_some_question_takes_a_novel_view(asked: Asked) -> None:
    _, _, rows = asked
    assert any(candidate.chosen and candidate.move != "initial" for row in rows for candidate in row.candidates)


def test_regions_hold_activated_gaussians_of_the_evidence_category_alone(asked: Asked) -> None:
    scene, _, rows = asked
    checked = 0
    for row in rows:
        for region in row.regions:
            names = {scene.semantics.vocabulary[i] for i in scene.semantics.category[list(region.gaussians)]}
            assert names <= set(row.answers[0].evidence)
            checked += bool(names)
    assert checked > 0


def test_model_says_in_every_row_that_it_is_symbolic(asked: Asked) -> None:
    _, _, rows = asked
    assert all("symbolic" in row.answers[0].model for row in rows)
    assert not any(call.outcome != "ok" for row in rows for call in row.calls)


def test_a_second_run_gives_the_same_rows(asked: Asked) -> None:
    scene, questions, rows = asked
    again = _answer(scene, questions[::4])
    for first, second in zip(rows[::4], again, strict=True):
        assert (first.answers, first.arms, first.clusters, first.candidates, first.regions) == (
            second.answers,
            second.arms,
            second.clusters,
            second.candidates,
            second.regions,
        )
