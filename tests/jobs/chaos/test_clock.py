"""The clock on the wall jumps by an hour while a run goes on: nothing that is decided depends on it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from jobs.runs.submit import resume, submit
from pipeline.models import journal
from pipeline.models.traffic import open_admissions
from schemas.errors import StopError
from tests.jobs.chaos.faulty_server import Call, FaultyServer, Spoiled
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.workers.calling_steps import CALLS, STEPS
from workers import limiter

TEXTS = [f"question {number}" for number in range(10)]
SENT = len(TEXTS) * (CALLS - 1) + 1
HOUR_S = 3600.0
A_MINUTE = 3000
"""Calls allowed in one: a rate that is there and holds nothing up."""


@pytest.mark.chaos("clock jump")
@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S], ids=["ahead", "back"])
def test_clock_that_jumps_in_a_session_and_between_two_changes_nothing(
    make_scene: Callable[..., Path],
    make_job: MakeJob,
    measured: Measured,
    monkeypatch: pytest.MonkeyPatch,
    jump_s: float,
) -> None:
    make_scene("a", TEXTS)
    jumps = [0.0]
    now = time.time

    def clock() -> float:
        return now() + sum(jumps)

    def fault(call: Call) -> Spoiled | None:
        """Calls fail now and then, so that tries wait; at every seventh the clock jumps."""
        jumps.extend([jump_s] * (call.number % 7 == 0))
        return Spoiled(429, ("Retry-After: 0.2",)) if call.number % 6 == 0 else None

    with FaultyServer() as server:
        endpoint = {"kind": "openai", "base_url": server.base_url, "model": "m", "max_tokens": 50}
        limits = {"requests_per_min": A_MINUTE, "concurrency": 4}
        models = {"endpoints": {"e": {**endpoint, **limits}}, "default": "e", "retry": {"first_wait_s": 0.1}}
        whole = submit(make_job("whole", models=models), steps=STEPS).run
        server.asked.clear()
        monkeypatch.setattr(time, "time", clock)
        monkeypatch.setattr(limiter, "open_admissions", partial(open_admissions, wall_clock=clock))
        server.number, server.fault = 0, fault
        job = make_job("hurt", models=models, budget={"calls": SENT // 2})
        assert isinstance(measured.run(lambda: submit(job, steps=STEPS)), StopError)
        jumps.append(jump_s)
        assert measured.run(lambda: resume(job.output, steps=STEPS, budget={"calls": 10 * SENT})) is None
    measured.compare(job.output, whole)
    measured.sent_twice = server.sent_twice
    assert server.sent_twice == 0
    assert measured.exits == [1, 0], "the cap that was set, and the end"
    assert measured.seconds is not None
    assert measured.seconds < journal.REMEMBERED_S, "nobody waited for the hour"
    measured.note = f"{len(jumps) - 1} jumps"
