"""Two runs question by question: what is paired, what is told, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jobs.scoring.compare import compare_runs
from jobs.scoring.scores import COUNTED, Options
from schemas.answers import AnswerRow, ArmRow
from schemas.calls import CallRow
from schemas.errors import InputError
from schemas.manifest import commit_unit
from schemas.plan import PLAN_FILE, PlannedUnit, encode_plan
from schemas.questions import Question
from schemas.run_folder import RunFolder
from tests.jobs.synthetic_run import write_run

QUICK = Options(resamples=200)
SCENES = ("s0", "s1", "s2")


def make_run(
    folder: Path,
    marks: dict[str, int | None],
    *,
    commit: bool = True,
    arm: str = "verified",
    text: str = "What is {}?",
    answer: str = "mark {}",
    judge: str = "gpt",
    sha: str = "0",
    tokens: int = 100,
) -> str:
    """Write a run whose questions q0, q1, ... have the given marks, spread over three scenes; None failed."""
    run = RunFolder(str(folder))
    units = []
    for place, scene in enumerate(SCENES):
        ids = [name for name in marks if int(name[1:]) % 3 == place]
        questions = tuple(Question(name, scene, "eqa", text.format(name), answer="a", category="c") for name in ids)
        if not questions:
            continue
        units.append(PlannedUnit(f"{place:032x}", len(units), scene, scene, sha * 64, "m", questions))
        if not commit:
            continue
        rows: dict[str, list[Any]] = {"answers": [], "arms": [], "calls": []}
        for question in questions:
            mark = marks[question.question_id]
            status = "failed" if mark is None else "answered"
            said = "" if mark is None else answer.format(mark)
            shared = (question.question_id, scene, "eqa", "c", "m")
            reason = "QuestionError: x" if mark is None else ""
            rows["answers"].append(
                AnswerRow(*shared, question.question, "a", (), 0, 0, 0, status, reason, said, "", 1, "gpt")
            )
            rows["arms"].append(ArmRow(*shared, arm, status, reason, said, (), (), 1, mark, "", None, None, None, None))
            rows["calls"].append(
                CallRow(
                    *(question.question_id, scene, "answer", "", "k", "e", "gpt", "p", 1, "ok", "r", tokens, 0),
                    *(0.0, 1.0, 0.1, False),
                )
            )
        commit_unit(run.root, units[-1].id, rows)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / PLAN_FILE).write_bytes(encode_plan(units))
    basis = {"models": {"judge": {"model": judge}}, "prompts": {}}
    run.write_run({"name": folder.name, "config": {"name": folder.name, "method": {"k": tokens}}, "basis": basis})
    return run.root


@pytest.fixture
def ab(tmp_path: Path) -> tuple[str, str]:
    """Twelve shared questions, of which one failed in A and one in B, and one of its own in each."""
    rng = np.random.default_rng(0)
    a: dict[str, int | None] = {f"q{i}": int(rng.integers(1, 5)) for i in range(12)}
    b: dict[str, int | None] = {name: (mark or 0) + (1 if i % 2 else 0) for i, (name, mark) in enumerate(a.items())}
    a |= {"q3": None, "q20": 3}
    b |= {"q4": None, "q30": 3}
    return make_run(tmp_path / "a", a), make_run(tmp_path / "b", b, tokens=150)


def test_difference_is_over_questions_scored_in_both(ab: tuple[str, str]) -> None:
    found = compare_runs(*ab, options=QUICK)
    row = found.scores[found.scores["metric"] == "llm_match"].to_dict("records")[0]
    assert (row["scored"], row["only_a"], row["only_b"], row["questions"]) == (10, 1, 1, 12)
    assert (row["gained"], row["lost"], row["tied"]) == (5, 0, 5)
    assert row["difference"] == pytest.approx(12.5)
    assert row["mean_b"] - row["mean_a"] == pytest.approx(row["difference"])
    assert row["low_questions"] <= row["difference"] <= row["high_questions"]
    assert row["scenes"] == 3
    assert 0 < row["p"] <= 1
    assert row["p_scenes"] >= 0.25, "three scenes can give no smaller p"


def test_what_only_one_run_has_is_listed(ab: tuple[str, str]) -> None:
    found = compare_runs(*ab, options=QUICK)
    assert found.unpaired[["run", "question_id"]].to_numpy().tolist() == [["a", "q20"], ["b", "q30"]]
    (counts,) = found.counts.to_dict("records")
    assert (counts["shared"], counts["only_a"], counts["only_b"], counts["answered_a"]) == (12, 1, 1, 11)


def test_questions_that_changed_are_told_with_both_answers(ab: tuple[str, str]) -> None:
    rows = compare_runs(*ab, options=QUICK).questions.set_index("question_id")
    assert len(rows) == 12
    assert rows["changed"].sum() == 7
    assert (rows.loc["q3", "status_a"], rows.loc["q3", "status_b"]) == ("failed", "answered")
    assert rows.loc["q3", "answer_a"] is None
    assert np.isnan(rows.loc["q3", "difference"])


def test_configuration_and_cost_are_compared_field_by_field(ab: tuple[str, str]) -> None:
    found = compare_runs(*ab, options=QUICK)
    assert found.config.to_dict("records") == [{"field": "config.method.k", "a": 100, "b": 150}]
    row = found.cost.set_index("stage").loc["all"]
    assert (row["calls_a"], row["tokens_a"], row["tokens_b"], row["tokens_difference"]) == (12, 1200, 1800, 600)


def test_a_run_against_itself_differs_in_nothing(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    found = compare_runs(run, run, options=QUICK)
    assert set(found.scores["arm_a"]) == {"initial", "final", "verified"}
    assert (found.scores["difference"].dropna() == 0).all()
    assert (found.scores["p"].dropna() == 1).all()
    assert not found.questions["changed"].any()
    assert found.config.empty
    assert found.warnings == ()


def test_two_arms_of_one_run_agree_with_its_own_differences(tmp_path: Path) -> None:
    from jobs.scoring.aggregate import aggregate

    run = write_run(tmp_path)
    found = compare_runs(run, run, arm="initial:final", options=QUICK).scores
    inner = aggregate(run, QUICK)["differences"]
    for row in found[~found["metric"].isin(COUNTED)].to_dict("records"):
        same = inner[(inner["task"] == row["task"]) & (inner["metric"] == row["metric"]) & (inner["to"] == "final")]
        (other,) = same[same["from"] == "initial"].to_dict("records")
        assert row["difference"] == pytest.approx(other["mean"])
        assert [row[n] for n in ("scored", "gained", "lost", "tied")] == [
            other[n] for n in ("scored", "gained", "lost", "tied")
        ]


def test_swapping_the_runs_turns_the_sign(ab: tuple[str, str]) -> None:
    there, back = compare_runs(*ab, options=QUICK).scores, compare_runs(*reversed(ab), options=QUICK).scores
    assert there["difference"].tolist() == pytest.approx((-back["difference"]).tolist())
    assert there["gained"].tolist() == back["lost"].tolist()


def test_other_judges_and_other_scenes_are_warned_of(tmp_path: Path) -> None:
    marks: dict[str, int | None] = {"q0": 1, "q1": 2, "q2": 3}
    runs = make_run(tmp_path / "a", marks), make_run(tmp_path / "b", marks, judge="other", sha="1")
    told = " ".join(compare_runs(*runs, options=QUICK).warnings)
    assert "the judges differ" in told
    assert "3 of 3 shared scenes have other files" in told


def test_an_incomplete_run_is_compared_and_says_so(tmp_path: Path) -> None:
    runs = write_run(tmp_path / "a"), write_run(tmp_path / "b", committed=1)
    found = compare_runs(*runs, options=QUICK)
    assert any("INCOMPLETE: 20 of 60" in warning for warning in found.warnings)
    assert (found.scores["scored"] <= 20).all()


class TestRefused:
    MARKS: dict[str, int | None] = {"q0": 1, "q1": 2}  # noqa: RUF012

    def test_runs_without_a_common_question(self, tmp_path: Path) -> None:
        runs = make_run(tmp_path / "a", self.MARKS), make_run(tmp_path / "b", {"q7": 1})
        with pytest.raises(InputError, match="2 and 1 questions with no id in common"):
            compare_runs(*runs)

    def test_other_texts_under_the_same_ids(self, tmp_path: Path) -> None:
        runs = make_run(tmp_path / "a", self.MARKS), make_run(tmp_path / "b", self.MARKS, text="Where is {}?")
        with pytest.raises(InputError, match="question of question q0: expected the same in both runs"):
            compare_runs(*runs)

    def test_a_run_with_nothing_committed(self, tmp_path: Path) -> None:
        runs = make_run(tmp_path / "a", self.MARKS), make_run(tmp_path / "b", self.MARKS, commit=False)
        with pytest.raises(InputError, match="b: expected a run with committed questions"):
            compare_runs(*runs)

    def test_arms_that_are_not_there(self, tmp_path: Path) -> None:
        runs = make_run(tmp_path / "a", self.MARKS), make_run(tmp_path / "b", self.MARKS, arm="blind")
        with pytest.raises(InputError, match="--arm verified:blind"):
            compare_runs(*runs)
        with pytest.raises(InputError, match="b: arm: expected one of blind, found verified"):
            compare_runs(*runs, arm="verified")
        assert len(compare_runs(*runs, arm="verified:blind", options=QUICK).questions) == 2

    def test_no_run(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="run folder"):
            compare_runs(make_run(tmp_path / "a", self.MARKS), tmp_path / "none")
