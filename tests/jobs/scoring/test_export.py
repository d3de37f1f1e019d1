"""Answers for other programs: nothing is invented, nothing is lost, and OpenEQA's own file comes back whole."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from jobs.scoring.export import answer_rows, export_run
from schemas.errors import InputError
from schemas.manifest import commit_unit
from schemas.plan import PLAN_FILE, PlannedUnit, encode_plan
from schemas.questions import Question
from schemas.run_folder import RunFolder, read_table
from tests.jobs.synthetic_run import write_run
from tests.workers.fake_steps import answer, arm


def read(path: Path) -> Any:
    return json.loads(path.read_text())


def official_final_score(dataset: list[dict[str, Any]], results: Any, marks: dict[str, int]) -> float:
    """What OpenEQA's tool makes of two files: it wants every question, and scores an answer that is null 0."""
    assert len(results) == len(dataset)
    assert {item["question_id"] for item in results} == {item["question_id"] for item in dataset}
    scores = [0 if item["answer"] is None else marks[item["question_id"]] for item in results]
    return sum(100.0 * (min(max(score, 1), 5) - 1) / 4 for score in scores) / len(scores)


def test_openeqa_files_have_what_the_rows_say_and_null_where_they_say_nothing(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    done = export_run(run, "openeqa", tmp_path / "out" / "results.json")
    arms = read_table(run, "arms")
    rows = arms[(arms["arm"] == "verified") & (arms["task"] == "eqa")].set_index("question_id")
    results = read(tmp_path / "out" / "results.json")
    assert [set(item) for item in results] == [{"question_id", "answer"}] * 30
    for item in results:
        row = rows.loc[item["question_id"]]
        assert item["answer"] == (row["answer"] if row["status"] == "answered" else None)
    marks = read(tmp_path / "out" / "results-metrics.json")
    assert marks == {name: int(mark) for name, mark in rows["mark"].dropna().items()}
    assert all(type(mark) is int for mark in marks.values())
    assert (done.planned, done.answered, done.scored) == (30, int((rows["status"] == "answered").sum()), len(marks))
    note = (tmp_path / "out" / "results-unanswered.txt").read_text().splitlines()
    assert "scores 0" in note[1]
    assert {line.split("\t")[0] for line in note[2:]} == set(rows.index[rows["status"] != "answered"])


def test_pending_questions_are_in_no_file_but_in_the_note(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", committed=1)
    done = export_run(run, "jsonl", tmp_path / "a.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert len(lines) == 20
    assert done.pending == 40
    assert sum("\tpending\t" in line for line in (tmp_path / "a-unanswered.txt").read_text().splitlines()) == 40
    assert {line["answer"] for line in lines if line["status"] != "answered"} == {None}


def test_the_note_goes_when_every_question_is_answered(tmp_path: Path) -> None:
    run = one_scene_run(tmp_path / "run", ["a", "b"])
    note = tmp_path / "r-unanswered.txt"
    note.write_text("of an export before the run was complete")
    assert export_run(run, "openeqa", tmp_path / "r.json").files == (
        str(tmp_path / "r.json"),
        str(tmp_path / "r-metrics.json"),
    )
    assert not note.exists()


def test_csv_has_a_row_a_question_whatever_the_texts_hold(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    export_run(run, "csv", tmp_path / "a.csv", arm="initial")
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    expected = answer_rows(run, "initial")
    assert [row["question_id"] for row in rows] == expected["question_id"].tolist()
    assert [row["answer"] for row in rows] == [text or "" for text in expected["answer"]]
    assert {row["arm"] for row in rows} == {"initial"}


def test_questions_that_failed_before_they_had_arms_are_there(tmp_path: Path) -> None:
    questions = (Question("q0", "s", "eqa", "What?", answer="a"), Question("q1", "s", "eqa", "Where?", answer="a"))
    unit = PlannedUnit("0" * 32, 0, "s", "s", "0" * 64, "m", questions)
    run = RunFolder(str(tmp_path / "run"))
    answers = [answer(questions[0], answer="x"), answer(questions[1], status="failed", reason="QuestionError: no")]
    commit_unit(run.root, unit.id, {"answers": answers, "arms": [arm(questions[0], "verified", answer="x")]})
    Path(run.root, PLAN_FILE).write_bytes(encode_plan([unit]))
    run.write_run({"name": "r"})
    rows = answer_rows(run.root).set_index("question_id")
    assert rows["status"].to_dict() == {"q0": "answered", "q1": "failed"}
    assert rows["reason"]["q1"] == "QuestionError: no"


@pytest.mark.parametrize("mistake", ["no run", "empty run", "arm", "task"])
def test_wrong_input_is_refused(tmp_path: Path, mistake: str) -> None:
    arm_name, message = "verified", ""
    if mistake == "no run":
        run, message = str(tmp_path / "none"), "run folder"
    elif mistake == "empty run":
        run, message = write_run(tmp_path, committed=0), "resume it first"
    elif mistake == "arm":
        run, arm_name, message = write_run(tmp_path / "run"), "best", "one of initial, final, verified, found best"
    else:
        run, message = one_scene_run(tmp_path / "run", ["a"], task="ground_one"), "eqa questions"
    with pytest.raises(InputError, match=message):
        export_run(run, "openeqa", tmp_path / "x.json", arm=arm_name)
    assert not (tmp_path / "x.json").exists()


def one_scene_run(folder: Path, answers: list[str], *, task: Any = "eqa") -> str:
    questions = tuple(Question(f"q{i}", "s", task, f"{i}?", answer="a") for i in range(len(answers)))
    run = RunFolder(str(folder))
    unit = PlannedUnit("0" * 32, 0, "s", "s", "0" * 64, "m", questions)
    rows = [answer(question, answer=text) for question, text in zip(questions, answers, strict=True)]
    arms = [arm(question, "verified", answer=text) for question, text in zip(questions, answers, strict=True)]
    commit_unit(run.root, unit.id, {"answers": rows, "arms": arms})
    Path(run.root, PLAN_FILE).write_bytes(encode_plan([unit]))
    run.write_run({"name": "r"})
    return run.root


def test_official_questions_make_the_round_trip(shared_data: Path, tmp_path: Path) -> None:
    """All 1,636 questions of OpenEQA: ids, order and answers survive, and its tool's arithmetic gives our score."""
    dataset = read(shared_data / "openeqa" / "open-eqa-v0.json")
    assert len(dataset) == 1_636
    run = RunFolder(str(tmp_path / "run"))
    questions, said, marked = [], {}, {}
    rows: dict[str, list[Any]] = {"answers": [], "arms": []}
    for place, item in enumerate(dataset):
        scene, extra = item.pop("episode_history"), tuple(item.pop("extra_answers", ()))
        question = Question(**item, scene=scene, task="eqa", extra_answers=extra)
        failed = place % 11 == 3
        text = None if failed else f'{question.answer} "{place}"\n'
        mark = None if failed else place % 6
        status = {"status": "failed", "reason": "QuestionError: x"} if failed else {}
        questions.append(question)
        said[question.question_id], marked[question.question_id] = text, mark
        rows["answers"].append(answer(question, answer=text or "", **status))
        rows["arms"].append(arm(question, "verified", answer=text or "", mark=mark, **status))
    unit = PlannedUnit("0" * 32, 0, "all", "all", "0" * 64, "m", tuple(questions))
    commit_unit(run.root, unit.id, rows)
    Path(run.root, PLAN_FILE).write_bytes(encode_plan([unit]))
    run.write_run({"name": "openeqa"})
    done = export_run(run.root, "openeqa", tmp_path / "results.json")
    results, marks = read(tmp_path / "results.json"), read(tmp_path / "results-metrics.json")
    assert [(item["question_id"], item["answer"]) for item in results] == list(said.items()), "the official order"
    assert marks == {name: mark for name, mark in marked.items() if mark is not None}
    assert (done.planned, done.pending, done.answered + done.unanswered) == (1_636, 0, 1_636)
    ours = [0.0 if mark is None else 25.0 * (min(max(mark, 1), 5) - 1) for mark in marked.values()]
    assert official_final_score(dataset, results, marks) == pytest.approx(sum(ours) / 1_636)
