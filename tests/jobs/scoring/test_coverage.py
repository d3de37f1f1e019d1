"""Denominators: every planned question is in every group, whatever became of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from jobs.scoring.aggregate import coverage, grouped
from jobs.scoring.scores import Options
from schemas.errors import InputError
from tests.jobs.synthetic_run import write_run

QUICK = Options(resamples=50)
STATUSES = ["answered", "unparsed", "failed", "skipped", "pending"]


@pytest.mark.parametrize("committed", [0, 1, None])
def test_statuses_add_up_to_what_was_planned_however_little_is_committed(tmp_path: Path, committed: int | None) -> None:
    run = write_run(tmp_path, committed=committed)
    covered = coverage(run)
    assert covered.planned == 60
    assert covered.pending == {0: 60, 1: 40, None: 0}[committed]
    assert bool(covered.notice()) == (committed is not None)
    for by in ((), ("category",), ("scene",), ("category", "scene")):
        rows = grouped(run, by, QUICK)
        assert (rows[STATUSES].sum(axis=1) == rows["questions"]).all()
        scores = rows[rows["metric"] != "frames"]
        assert (scores["scored"] <= scores["answered"]).all()
        for _, arm in rows[rows["metric"] == "frames"].groupby("arm", observed=True):
            assert arm["questions"].sum() == 60


def test_pending_questions_are_in_no_mean_and_not_counted_as_zero(tmp_path: Path) -> None:
    one = grouped(write_run(tmp_path / "one", committed=1), ("scene",), QUICK)
    whole = grouped(write_run(tmp_path / "whole"), ("scene",), QUICK)
    same = ["mean", "mean_zero", "low", "high", "scored", "questions"]
    first = one[one["scene"] == "flat 1"].reset_index(drop=True)
    assert first[same].equals(whole[whole["scene"] == "flat 1"].reset_index(drop=True)[same])
    others = one[one["scene"] != "flat 1"]
    assert others["mean"].isna().all()
    assert others["mean_zero"].isna().all()
    assert (others["pending"] == others["questions"]).all()


def test_a_group_has_the_same_interval_in_every_table(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    tables = [grouped(run, by, QUICK) for by in (("task",), ("arm",), ("method", "task"))]
    assert tables[0].equals(tables[1])
    assert tables[0].equals(tables[2])


@pytest.mark.parametrize("by", [("colour",), ("task", "task")])
def test_unknown_or_doubled_groups_are_refused(tmp_path: Path, by: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="--by"):
        grouped(write_run(tmp_path), by, QUICK)
