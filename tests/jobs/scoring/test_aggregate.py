"""Metrics of a run folder: they come from committed rows only and agree with the rows."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from jobs.scoring.aggregate import aggregate, aggregate_tables
from jobs.scoring.scores import Options
from schemas.calls import CallRow, TimingRow
from schemas.errors import InputError
from schemas.run_folder import read_table
from tests.jobs.synthetic_run import synthetic_rows, write_run

QUICK = Options(resamples=100)
CALL = CallRow("q0", "s", "answer", "", "k", "gpt", "m", "p", 1, "ok", "r", 100, 10, 0.0, 2.0, None, False)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_run(tmp_path_factory.mktemp("run"))


def _frame(rows: list[Any], record: type[Any]) -> pd.DataFrame:
    return pd.DataFrame([asdict(row) for row in rows], columns=list(record.__dataclass_fields__))


def _tables(calls: list[CallRow], timings: list[TimingRow], questions: int = 4) -> dict[str, pd.DataFrame]:
    rows = synthetic_rows(questions)
    tables = {name: pd.DataFrame([asdict(row) for row in rows[name]]) for name in ("answers", "arms", "clusterings")}
    return tables | {"calls": _frame(calls, CallRow), "timings": _frame(timings, TimingRow)}


def _record(frame: pd.DataFrame, **where: str) -> dict[str, Any]:
    for column, value in where.items():
        frame = frame[frame[column] == value]
    (row,) = frame.to_dict("records")
    return {str(name): value for name, value in row.items()}


def test_aggregate_agrees_with_the_rows_of_the_run(run: str) -> None:
    metrics = aggregate(run, QUICK)
    arms = read_table(run, "arms")
    for arm in ("initial", "final", "verified"):
        marks = arms[(arms["arm"] == arm) & (arms["task"] == "eqa")]["mark"].dropna().astype(float)
        row = _record(metrics["arms"], arm=arm, metric="llm_match")
        assert row["mean"] == pytest.approx((25 * (marks - 1)).mean())
        assert row["scored"] == len(marks)
        assert row["questions"] == 30
        ious = arms[(arms["arm"] == arm) & (arms["task"] == "ground_one")]["iou"].dropna()
        assert _record(metrics["arms"], arm=arm, metric="miou")["mean"] == pytest.approx(100 * ious.mean())
        acc = _record(metrics["arms"], arm=arm, task="ground_one", metric="acc@10")["mean"]
        assert acc == pytest.approx(100 * (ious > 0.1).mean())
    for by in ("by_category", "by_scene"):
        parts = metrics[by][(metrics[by]["metric"] == "llm_match") & (metrics[by]["arm"] == "final")]
        whole = _record(metrics["arms"], arm="final", metric="llm_match")
        assert parts["scored"].sum() == whole["scored"]
        assert (parts["mean"] * parts["scored"]).sum() == pytest.approx(whole["mean"] * whole["scored"])


def test_aggregate_twice_gives_the_same_frames(run: str) -> None:
    first, second = aggregate(run, QUICK), aggregate(run, QUICK)
    for name in first:
        pd.testing.assert_frame_equal(first[name], second[name])


def test_aggregate_scores_committed_units_and_counts_the_others_as_pending(tmp_path: Path) -> None:
    metrics = aggregate(write_run(tmp_path, committed=1), QUICK)
    outcomes = metrics["outcomes"]
    assert outcomes["questions"].sum() == 60
    assert outcomes[outcomes["status"] == "pending"]["questions"].sum() == 40
    assert (metrics["arms"].groupby("task", observed=True)["questions"].max() == [30, 15, 15]).all()
    scored = metrics["by_scene"][metrics["by_scene"]["scored"] > 0]
    assert set(scored["scene"]) == {"flat 1"}


def test_aggregate_tables_without_a_plan_counts_the_rows_there_are() -> None:
    assert aggregate_tables(_tables([], []), QUICK)["arms"]["pending"].sum() == 0


def test_aggregate_of_a_run_without_committed_units_has_no_score(tmp_path: Path) -> None:
    metrics = aggregate(write_run(tmp_path, committed=0), QUICK)
    assert metrics["arms"]["scored"].sum() == 0
    assert metrics["arms"]["mean"].isna().all()
    assert (metrics["outcomes"]["status"] == "pending").all()
    assert metrics["differences"]["scored"].sum() == 0
    assert len(metrics["clusters_by_scene"]) == 0


def test_aggregate_no_run_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        aggregate(tmp_path)


def test_outcomes_list_status_and_reason(run: str) -> None:
    outcomes = aggregate(run, QUICK)["outcomes"]
    assert outcomes["questions"].sum() == 60
    assert _record(outcomes, status="failed")["reason"] == "QuestionError: refused"
    assert outcomes[outcomes["task"] == "eqa"]["status"].tolist() == ["answered", "failed", "skipped"]


def test_calls_are_counted_once_and_failed_tries_apart() -> None:
    calls = [
        replace(CALL, outcome="RateLimitError", prompt_tokens=0, completion_tokens=0),
        replace(CALL, outcome="unparsed"),
        replace(CALL, attempt=2),
        replace(CALL, cached=True, latency_s=0.0),
        replace(CALL, stage="judge", model="j"),
    ]
    metrics = aggregate_tables(_tables(calls, []), QUICK)["calls"]
    row = _record(metrics, stage="answer")
    assert {name: row[name] for name in ("calls", "sent", "cached", "asked_again", "unparsed", "failed_tries")} == {
        "calls": 3,
        "sent": 2,
        "cached": 1,
        "asked_again": 1,
        "unparsed": 1,
        "failed_tries": 1,
    }
    assert (row["prompt_tokens"], row["completion_tokens"], row["sent_tokens"]) == (300, 30, 220)
    assert (row["calls_a_question"], row["tokens_a_question"], row["seconds_a_call"]) == (3 / 4, 330 / 4, 2.0)
    assert _record(metrics, stage="method")["calls"] == 3
    assert _record(metrics, stage="all")["calls"] == 4
    assert _record(metrics, stage="all")["models"] == "j, m"


def test_calls_sum_waits_and_prices_of_what_was_sent() -> None:
    calls = [
        replace(CALL, wait_s=1.5, usd=0.25),
        replace(CALL, outcome="RateLimitError", wait_s=2.0, usd=None),
        replace(CALL, cached=True, usd=0.0),
        replace(CALL, stage="judge", usd=None),
    ]
    metrics = aggregate_tables(_tables(calls, []), QUICK)["calls"]
    row = _record(metrics, stage="answer")
    assert (row["seconds_waited"], row["usd"], row["usd_a_question"]) == (3.5, 0.25, 0.0625)
    assert pd.isna(_record(metrics, stage="all")["usd"]), "a part is unknown"


def test_calls_of_nothing_have_no_ratios() -> None:
    row = _record(aggregate_tables(_tables([], []), QUICK)["calls"], stage="all")
    assert (row["calls"], row["calls_a_question"]) == (0, 0)
    assert row["seconds_a_call"] is None or pd.isna(row["seconds_a_call"])


def test_timings_keep_scene_work_apart() -> None:
    timings = [
        TimingRow("", "flat 1", "index", 6.0, 120),
        TimingRow("q0", "flat 1", "render", 1.0, 4),
        TimingRow("q1", "flat 1", "render", 3.0, 4),
        TimingRow("q1", "flat 1", "cluster", 1.0, 2),
        TimingRow("q1", "flat 1", "zeta", 1.0, 0),
    ]
    frame = aggregate_tables(_tables([], timings), QUICK)["timings"]
    assert frame["stage"].tolist() == ["index", "all", "cluster", "render", "zeta", "all"]
    assert _record(frame, stage="index")["seconds_each"] == 2.0
    render = _record(frame, stage="render")
    assert (render["seconds"], render["seconds_each"], render["seconds_an_item"], render["longest"]) == (4, 1, 0.5, 3)
    assert _record(frame, stage="all", once_a="question")["seconds_each"] == 1.5
    assert pd.isna(_record(frame, stage="zeta")["seconds_an_item"])
