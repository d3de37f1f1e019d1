from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest

import jobs.plan
from jobs.plan import basis_of, plan_units
from pipeline.models.messages import Stage
from schemas.errors import InputError
from schemas.question_file import save_questions
from tests.jobs.conftest import MakeJob
from tests.workers.fake_steps import unit

MakeScene = Callable[..., Path]


def ids(job: Any) -> list[str]:
    return [planned.id for planned in plan_units(job)]


def test_units_cut_each_scene_into_chunks_in_order(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("b", ["q"] * 4)
    make_scene("a", ["q"] * 7)
    units = plan_units(make_job())
    assert [(u.index, u.scene, len(u.questions)) for u in units] == [
        (0, "a", 3),
        (1, "a", 3),
        (2, "a", 1),
        (3, "b", 3),
        (4, "b", 1),
    ]
    assert len({u.id for u in units}) == 5
    assert [q.question_id for u in units for q in u.questions][:3] == ["a-0", "a-1", "a-2"]


def test_unit_ids_come_from_content_alone(make_scene: MakeScene, make_job: MakeJob, tmp_path: Path) -> None:
    make_scene("a", ["q"] * 4)
    before = ids(make_job())
    assert ids(make_job("elsewhere", name="other", images=False, workers={"cpus": 7, "retries": 9})) == before
    moved = tmp_path / "moved"
    (tmp_path / "scenes").rename(moved)
    assert ids(make_job(scenes=str(moved / "a"))) == before


@pytest.mark.parametrize("change", ["gaussians", "more files", "question", "method", "models", "stage"])
def test_unit_ids_change_with_anything_that_can_change_an_answer(
    make_scene: MakeScene, make_job: MakeJob, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    scene = make_scene("a", ["q"] * 4)
    before, changes = ids(make_job()), dict[str, Any]()
    if change == "gaussians":
        (scene / "gaussians.ply").write_bytes(b"other splats")
    elif change == "more files":
        (scene / "images").mkdir()
        (scene / "images" / "1.jpg").write_bytes(b"x")
    elif change == "question":
        changed = dataclasses.replace(unit(0, ["q"] * 4, "a").questions[0], answer="no")
        save_questions([changed, *unit(0, ["q"] * 4, "a").questions[1:]], scene / "questions.jsonl")
    elif change == "method":
        changes["method"] = {"novel_views": {"count": 2}}
    elif change == "models":
        changes["models"] = {"max_asks": 5}
    else:
        monkeypatch.setattr(jobs.plan, "STAGES", {**jobs.plan.STAGES, "perturb": jobs.plan.STAGES["perturb"] + 1})
    after = ids(make_job(**changes))
    assert after[0] != before[0]
    assert (after[1] == before[1]) == (change == "question"), "a question's change leaves the other units alone"


def test_truth_about_objects_is_no_content_of_a_scene(make_scene: MakeScene, make_job: MakeJob) -> None:
    scene = make_scene("a", ["q"])
    before = ids(make_job())
    (scene / "objects.json").write_text("[]")
    assert ids(make_job()) == before


def test_basis_names_every_stage_prompt_and_model(make_scene: MakeScene, make_job: MakeJob) -> None:
    basis = basis_of(make_job())
    assert set(basis.models) == set(get_args(Stage))
    assert set(basis.prompts) > set(basis.models) - {"evidence"}
    assert all(len(value) == 64 for value in basis.prompts.values())
    assert set(basis.method) == set(make_job().method.model_dump())


def test_tasks_and_limit_keep_the_first_of_each_scene(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q"] * 4)
    make_scene("b", ["q"] * 4)
    assert [len(u.questions) for u in plan_units(make_job(limit=2))] == [2, 2]
    with pytest.raises(InputError, match="questions: expected a question of task ground_one, found none"):
        plan_units(make_job(tasks=["ground_one"]))


@pytest.mark.parametrize(
    ("scenes", "message"),
    [
        ("scenes/none*", "scenes: expected a pattern that matches folders"),
        ("scenes/missing", "scenes: expected a scene folder, found nothing at "),
        (["scenes/a", "scenes/a"], "scenes: expected each scene once"),
        (["scenes/a", "scenes/../scenes/a"], "scenes: expected each scene once"),
        (["scenes/a", "scenes/empty"], "empty: gaussians: expected one splat file"),
        (["scenes/a", "scenes/same"], "same: name: expected a name no other scene has, found a"),
    ],
)
def test_wrong_scenes_are_refused(
    make_scene: MakeScene, make_job: MakeJob, tmp_path: Path, scenes: Any, message: str
) -> None:
    make_scene("a", ["q"])
    same = make_scene("same", ["q"])
    (same / "scene.json").write_text('{"name": "a"}')
    (tmp_path / "scenes" / "empty").mkdir()
    (tmp_path / "scenes" / "empty" / "note.txt").write_text("x")
    given = [str(tmp_path / s) for s in ([scenes] if isinstance(scenes, str) else scenes)]
    with pytest.raises(InputError, match=message):
        plan_units(make_job(scenes=given))


def test_repeated_question_id_in_two_scenes_is_refused(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q"])
    other = make_scene("b", ["q"])
    save_questions(
        [dataclasses.replace(unit(0, ["q"], "b").questions[0], question_id="a-0")], other / "questions.jsonl"
    )
    with pytest.raises(InputError, match=r"question_id: expected an id no other question has, found 'a-0', also in"):
        plan_units(make_job())


def test_question_about_a_scene_that_is_not_listed_is_refused_or_skipped(
    make_scene: MakeScene, make_job: MakeJob, tmp_path: Path
) -> None:
    make_scene("a", ["q"])
    file = tmp_path / "all.jsonl"
    save_questions([*unit(0, ["q"], "a").questions, *unit(0, ["q"], "elsewhere").questions], file)
    with pytest.raises(InputError, match=r"scene of question 'elsewhere-0': expected one of the job's scenes \(a\)"):
        plan_units(make_job(questions=str(file)))
    (planned,) = plan_units(make_job(questions=str(file), other_scenes="skip"))
    assert [q.question_id for q in planned.questions] == ["a-0"]


def test_scene_without_a_question_file_is_refused(make_scene: MakeScene, make_job: MakeJob) -> None:
    (make_scene("a", ["q"]) / "questions.jsonl").unlink()
    with pytest.raises(InputError, match=r"questions.jsonl: expected a file that can be read, found nothing there"):
        plan_units(make_job())
