from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest

import jobs.dataset
from jobs.runs import plan as plan_module
from jobs.runs.plan import basis_of, plan_units
from pipeline.models.messages import Stage
from schemas.errors import InputError
from schemas.question_file import save_questions
from tests.jobs.conftest import CAMERAS, MakeJob
from tests.workers.fake_steps import unit

MakeScene = Callable[..., Path]


def ids(job: Any) -> list[str]:
    return [planned.id for planned in plan_units(job)]


def test_units_cut_each_scene_into_chunks_in_order(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("b", ["q"] * 4)
    make_scene("a", ["q"] * 7)
    units = list(plan_units(make_job()))
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
        monkeypatch.setattr(plan_module, "STAGES", {**plan_module.STAGES, "perturb": plan_module.STAGES["perturb"] + 1})
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
        ("scenes/[m]issing", "scenes: expected a pattern that matches folders"),
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
    with pytest.raises(InputError, match=r"questions.jsonl: expected a file, found nothing there"):
        plan_units(make_job())


def problems_of(job: Any) -> list[str]:
    """All that planning says about a wrong job, one problem an entry."""
    with pytest.raises(InputError) as caught:
        plan_units(job)
    return [str(caught.value), *getattr(caught.value, "__notes__", ())]


def line(**fields: Any) -> str:
    return json.dumps({"question_id": "x", "scene": "a", "task": "eqa", "question": "q", **fields}) + "\n"


def test_every_problem_of_a_question_file_is_told_with_its_line(make_scene: MakeScene, make_job: MakeJob) -> None:
    file = make_scene("a", ["q"]) / "questions.jsonl"
    lines = [
        line(question_id="1"),
        "not json\n",
        "\n",
        line(question_id="2", anwser="yes"),
        line(question_id="3", task="walk"),
        line(question_id="4", target_ids=[10**30]),
        line(question_id="5", question="\ud800"),
        "[" * 100_000 + "\n",
        "9" * 5_000 + "\n",
        line(question_id="1"),
        line(question_id="6", scene="b"),
    ]
    file.write_bytes("".join(lines).encode() + b"\xff\n")
    found = problems_of(make_job())
    assert [text.partition(": ")[0].removeprefix(f"{file} line ") for text in found] == [
        *("2", "4", "5", "6", "7", "8", "9", "11", "12", "10")
    ]
    for text, said in zip(
        found,
        ["Expecting value", "anwser", "task", "target_ids", "surrogate", "", "", "'b'", "UTF-8", f"{file} line 1"],
        strict=True,
    ):
        assert said in text


def test_problems_of_all_scenes_and_files_are_told_at_once(make_scene: MakeScene, make_job: MakeJob) -> None:
    for name in "abcdefg":
        make_scene(name, ["q"])
    scenes = make_scene("h", ["q"]).parent
    (scenes / "b" / "gaussians.ply").unlink()
    (scenes / "c" / "scene.json").write_text('{"name": "c", "upp": [0, 0, 1]}')
    broken = json.loads(json.dumps(CAMERAS).replace("1.0", "NaN"))
    (scenes / "d" / "transforms.json").write_text(json.dumps(broken))
    (scenes / "e" / "transforms.json").unlink()
    (scenes / "f" / "questions.jsonl").write_text("")
    (scenes / "g" / "questions.jsonl").write_text(line(question_id="a-0", scene="g"))
    found = problems_of(make_job())
    wanted = [
        (scenes / "b", "gaussians: expected one splat file"),
        (scenes / "c", "upp"),
        (scenes / "d", "at least one usable view"),
        (scenes / "e", "cameras"),
        (scenes / "f" / "questions.jsonl", "at least one question"),
        (scenes / "g" / "questions.jsonl", "also in"),
    ]
    assert len(found) == len(wanted)
    for text, (place, said) in zip(found, wanted, strict=True):
        assert str(place) in text
        assert said in text


def test_views_with_an_unusable_pose_are_reported(make_scene: MakeScene, make_job: MakeJob) -> None:
    cameras = copy.deepcopy(CAMERAS)
    broken = {"file_path": "2.png", "transform_matrix": [[float("nan")] * 4] * 4}
    cameras["frames"].append(broken)
    (make_scene("a", ["q"]) / "transforms.json").write_text(json.dumps(cameras))
    told: list[str] = []
    assert len(list(plan_units(make_job(), warn=told.append))) == 1
    (text,) = told
    assert "skipped 1 of 2 views with an unusable pose" in text


def test_a_thousand_problems_are_counted(make_scene: MakeScene, make_job: MakeJob) -> None:
    (make_scene("a", ["q"]) / "questions.jsonl").write_text("x\n" * 1_000)
    found = problems_of(make_job())
    assert (len(found), found[-1]) == (101, "and 900 more")


def test_one_file_for_all_scenes_is_cut_by_scene_in_the_jobs_order(
    make_scene: MakeScene, make_job: MakeJob, tmp_path: Path
) -> None:
    for name in ("b", "a", "c"):
        make_scene(name, ["q"])
    file = tmp_path / "all.jsonl"
    lines = [line(question_id=f"{n}", scene="ba"[n % 2], question=f"où {n}?") for n in range(7)]
    file.write_text("\ufeff" + "\n".join(lines), encoding="utf-8")
    units = list(plan_units(make_job(questions=str(file))))
    assert [(u.scene, [q.question_id for q in u.questions]) for u in units] == [
        ("a", ["1", "3", "5"]),
        ("b", ["0", "2", "4"]),
        ("b", ["6"]),
    ]
    assert units[0].questions[1].question == "où 3?"


def test_plan_holds_one_scene_at_a_time(
    make_scene: MakeScene, make_job: MakeJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "abc":
        make_scene(name, ["q"] * 2)
    units = plan_units(make_job())
    hashed: list[str] = []
    sha256 = jobs.dataset.scene_sha256

    def watched(uri: str) -> str:
        hashed.append(uri)
        return sha256(uri)

    monkeypatch.setattr(jobs.dataset, "scene_sha256", watched)
    next(units)
    assert [Path(uri).name for uri in hashed] == ["a"]


def test_question_file_that_changes_while_it_is_planned_is_refused(make_scene: MakeScene, make_job: MakeJob) -> None:
    file = make_scene("a", ["q"] * 2) / "questions.jsonl"
    units = plan_units(make_job())
    file.write_text("x" + file.read_text())
    with pytest.raises(InputError, match=r"questions.jsonl byte 0: expected a JSON object"):
        next(units)


def test_a_table_version_that_only_notes_more_changes_no_unit(make_scene: MakeScene, make_job: MakeJob) -> None:
    """A run that was planned before rows of calls held the text of requests is gone on with."""
    make_scene("a", ["q"] * 2)
    assert basis_of(make_job()).tables["calls"] == 2
    kept, dropped = (make_job(models={"keep_prompts": keep}) for keep in (True, False))
    assert ids(kept) == ids(dropped)
