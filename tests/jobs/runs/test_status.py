"""How far a run is: from its folder alone, and true after crashes and retries."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from jobs.runs.failures import UNREADABLE, FailedRows
from jobs.runs.status import RECENT_S, run_status
from schemas.errors import InputError
from schemas.run_folder import read_table
from tests.jobs.synthetic_run import write_run

BEGUN = datetime(2026, 1, 1, tzinfo=UTC)
UNITS = [f"{index:032x}" for index in range(3)]


def diary(run: str, *events: tuple[float, str, dict[str, Any]]) -> None:
    """Write a diary: seconds since the beginning, kind, details."""
    lines = [
        json.dumps({"time": (BEGUN + timedelta(seconds=at)).isoformat(), "event": kind, **details}) + "\n"
        for at, kind, details in events
    ]
    Path(run, "events.jsonl").write_text("".join(lines))


def failed(unit: str, question: str, message: str = "refused") -> tuple[float, str, dict[str, Any]]:
    return 1.0, "failed", {"unit": unit, "question": question, "error": "QuestionError", "message": message}


def test_counts_come_from_plan_and_manifests(tmp_path: Path) -> None:
    found = run_status(write_run(tmp_path, committed=2))
    assert (found.units, found.units_done, found.questions, found.questions_done) == (3, 2, 60, 40)
    assert sum(found.statuses.values()) == 40
    assert not found.complete
    assert not found.running
    assert (found.driver, found.quiet_s, found.per_minute, found.calls, found.paid) == ("", None, None, None, None)
    assert run_status(write_run(tmp_path / "whole")).complete


def test_rate_of_the_latest_session_and_of_the_last_minutes(tmp_path: Path) -> None:
    run = write_run(tmp_path, committed=2)
    commits = [(60.0 * minute, "committed", {"unit": f"u{minute}", "questions": 10}) for minute in (1, 2)]
    late = 60.0 * 2 + RECENT_S + 60
    diary(
        run,
        (-9e3, "started", {}),
        (-8e3, "committed", {"unit": "old", "questions": 1_000}),
        (0.0, "started", {}),
        *commits,
        (late, "committed", {"unit": "u3", "questions": 10}),
        (late + 60, "committed", {"unit": "u4", "questions": 30}),
    )
    found = run_status(run)
    assert found.per_minute == pytest.approx(60 / ((late + 60) / 60))
    assert found.recent_per_minute == pytest.approx(30)
    assert found.minutes_left == pytest.approx(20 / 30)


def test_failures_are_told_by_the_rows_of_committed_units_and_by_the_diary_of_those_under_way(tmp_path: Path) -> None:
    run = write_run(tmp_path, committed=2)
    rows = read_table(run, "answers").query("status == 'failed'")["question_id"].tolist()
    diary(
        run,
        (0.0, "started", {}),
        failed(UNITS[0], rows[0], "an error that its row no longer has"),
        (2.0, "committed", {"unit": UNITS[0], "questions": 20}),
        failed(UNITS[2], "q9999"),  # its unit is not committed when the driver dies
        (9.0, "started", {}),
        failed(UNITS[1], "q9998"),  # an object store's diary lags: the unit is committed
        failed(UNITS[2], "q0002", "another"),
        failed(UNITS[2], "q0008", "one more"),
        failed(UNITS[2], "q0011", "one more"),
    )
    (found,) = run_status(run).failures
    assert (found.error, found.questions) == ("QuestionError", len(rows) + 3)
    assert (found.message, found.example) == ("refused", rows[0]) if len(rows) > 2 else ("one more", "q0008")


def test_failures_of_rows_that_cannot_be_read_are_counted_and_say_why(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    count = len(read_table(run, "answers").query("status == 'failed'"))
    part = next(Path(run, "answers").glob(f"{UNITS[0]}*"))
    part.write_bytes(part.read_bytes()[:-9])
    good, bad = run_status(run).failures
    assert (good.error, bad.error) == ("QuestionError", UNREADABLE)
    assert good.questions + bad.questions == count
    assert part.name in bad.message


def test_a_later_look_opens_only_what_is_new(tmp_path: Path) -> None:
    run = write_run(tmp_path, committed=2)
    rows = FailedRows(run)
    before = run_status(run, rows).failures
    for part in Path(run, "answers").iterdir():
        part.unlink()
    assert run_status(run, rows).failures == before
    assert run_status(run).failures != before


def test_calls_and_retries_are_summed_over_sessions(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    calls = {"calls": 10, "cached": 4, "failed_tries": 1, "tokens": 500, "usd": 0.5}
    diary(
        run,
        (0.0, "started", {}),
        (1.0, "retry", {"error": "WorkerLostError"}),
        (2.0, "committed", {"unit": UNITS[0], "questions": 20, "calls": calls}),
        (3.0, "started", {}),
        (4.0, "retry", {"error": "WorkerLostError"}),
        (5.0, "committed", {"unit": UNITS[0], "questions": 20, "calls": calls}),
    )
    found = run_status(run)
    assert found.retries == {"WorkerLostError": 2}
    assert found.calls is not None
    assert (found.calls.calls, found.calls.sent, found.calls.usd) == (20, 12, 1.0)
    assert json.loads(json.dumps(found.as_json()))["calls"]["tokens"] == 1_000


def test_no_run_and_a_run_without_its_plan_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="run folder"):
        run_status(str(tmp_path))
    run = write_run(tmp_path)
    Path(run, "plan.parquet").write_bytes(b"nothing")
    with pytest.raises(InputError, match="plan"):
        run_status(run)
    Path(run, "plan.parquet").unlink()
    with pytest.raises(InputError, match=r"plan\.parquet"):
        run_status(run)
