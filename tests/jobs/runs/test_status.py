"""How far a run is: from its folder alone, and true after crashes and retries."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from jobs.runs.status import RECENT_S, run_status
from schemas.errors import InputError
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


def test_failures_are_those_that_stand(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    diary(
        run,
        (0.0, "started", {}),
        failed(UNITS[0], "q0"),
        failed(UNITS[0], "q3"),
        (2.0, "committed", {"unit": UNITS[0], "questions": 20}),
        failed(UNITS[1], "q1"),  # its unit is not committed when the driver dies
        (9.0, "started", {}),
        failed(UNITS[1], "q4"),
        (10.0, "committed", {"unit": UNITS[1], "questions": 20}),
        failed(UNITS[2], "q2", "another"),
    )
    found = run_status(run)
    assert [(f.message, f.questions) for f in found.failures] == [("refused", 3), ("another", 1)]
    assert found.failures[0].example == "q0"
    assert found.reasons == {"QuestionError: refused": 3, "QuestionError: another": 1}
    with Path(run, "events.jsonl").open("a") as stream:
        stream.write(
            json.dumps({"time": BEGUN.isoformat(), "event": "discarded", "unit": UNITS[0], "redone": []}) + "\n"
        )
        stream.write(json.dumps({"time": BEGUN.isoformat(), "event": "damaged", "scene": "flat 1"}) + "\n")
    assert run_status(run).reasons == {"QuestionError: refused": 1, "QuestionError: another": 1}


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
