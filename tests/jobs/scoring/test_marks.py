"""OpenEQA's metrics files read back: its tool's arithmetic on them is our score."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jobs.scoring.aggregate import coverage, grouped_scores
from jobs.scoring.export import export_run
from jobs.scoring.marks import read_marks, with_marks
from schemas.errors import InputError
from tests.jobs.synthetic_run import write_run


def test_exported_marks_come_back_as_the_runs_own_score(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    export_run(run, "openeqa", tmp_path / "results.json")
    covered = coverage(run)
    remarked = with_marks(covered, read_marks(str(tmp_path / "results-metrics.json")), "verified")
    ours, theirs = (grouped_scores(found, ["category"]) for found in (covered, remarked.covered))
    ours = ours[(ours["arm"] == "verified") & (ours["task"] == "eqa")].reset_index(drop=True)
    assert len(ours) == 2 * 2
    pd.testing.assert_frame_equal(theirs, ours, check_dtype=False, check_categorical=False)
    assert remarked.others == 0


def test_marks_of_another_judge_give_the_official_score(tmp_path: Path) -> None:
    covered = coverage(write_run(tmp_path / "run"))
    arms = covered.arms
    answered = arms[(arms["task"] == "eqa") & (arms["arm"] == "final") & (arms["status"] == "answered")]
    rng = np.random.default_rng(0)
    marks = {name: int(rng.integers(0, 6)) for name in answered["question_id"]}
    remarked = with_marks(covered, {**marks, "somewhere else": 5}, "final")
    (row,) = grouped_scores(remarked.covered, []).query("metric == 'llm_match'").to_dict("records")
    official = np.mean(100.0 * (np.clip([*marks.values()], 1, 5) - 1) / 4)
    assert row["mean"] == pytest.approx(official)
    assert (remarked.used, remarked.others) == (len(marks), 1)


def test_questions_that_the_file_lacks_are_unscored_and_those_unanswered_stay_so(tmp_path: Path) -> None:
    covered = coverage(write_run(tmp_path / "run"))
    everyone = {name: 5 for name in covered.arms["question_id"]}
    some = dict([*everyone.items()][::2])
    row = grouped_scores(with_marks(covered, some, "initial").covered, []).iloc[0]
    assert row["scored"] < row["answered"] <= row["questions"]
    full = grouped_scores(with_marks(covered, everyone, "initial").covered, []).iloc[0]
    assert full["scored"] == full["answered"] < full["questions"]


@pytest.mark.parametrize("text", ["[]", "{", '{"q": "5"}', '{"q": true}', '{"q": 2.5}', "\x80"])
def test_wrong_files_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "marks.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"marks\.json"):
        read_marks(str(path))


def test_unknown_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="initial, final, verified"):
        with_marks(coverage(write_run(tmp_path / "run")), {}, "best")
