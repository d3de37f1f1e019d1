"""Runs whose model server fails in every way: what was answered is paid once, and the rows are those of a good day."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from jobs.config import JobConfig
from jobs.runs.retry import retry
from jobs.runs.submit import resume, submit
from pipeline.models.traffic import open_admissions
from schemas.run_folder import read_table
from tests.jobs.chaos.faulty_server import Call, Fault, FaultyServer, Spoiled
from tests.jobs.chaos.measured import Measured, Rows, answers, rows
from tests.jobs.conftest import MakeJob
from tests.workers.calling_steps import CALLS, STEPS
from workers import limiter

TEXTS = [f"question {number}" for number in range(10)]
SENT = len(TEXTS) * (CALLS - 1) + 1
CONCURRENCY = 4
READ_TIMEOUT_S = 0.5
HOUR_S = 3600.0
RETRY = {"first_wait_s": 0.1, "max_wait_s": 0.4, "max_tries": 8}
KEY = "sk-never-to-be-written-0000"
KEY_ENV = "CHAOS_KEY"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[FaultyServer]:
    monkeypatch.setenv(KEY_ENV, KEY)
    with FaultyServer() as found:
        yield found


@pytest.fixture
def make(make_job: MakeJob, server: FaultyServer) -> Callable[..., JobConfig]:
    """Make a job that asks the server."""
    endpoint = {
        **{"kind": "openai", "base_url": server.base_url, "model": "m", "max_tokens": 50, "key_env": KEY_ENV},
        **{"concurrency": CONCURRENCY, "read_timeout_s": READ_TIMEOUT_S},
    }
    models = {"endpoints": {"e": endpoint}, "default": "e", "retry": RETRY}
    return partial(make_job, models=models)


@pytest.fixture
def whole(make_scene: Callable[..., Path], make: Callable[..., JobConfig], server: FaultyServer) -> Rows:
    """Rows of a run with a server that works; its calls are forgotten."""
    make_scene("a", TEXTS)
    found = rows(submit(make("whole"), steps=STEPS).run)
    assert server.sent == SENT
    server.asked.clear()
    server.number = 0
    return found


def storm(call: Call) -> Spoiled | None:
    """Of the first 40 calls all but every fifth are refused, half of them with a wait."""
    wait = ("Retry-After: 0.1",) if call.number % 2 else ()
    return Spoiled(429, wait) if call.number <= 40 and call.number % 5 else None


def burst(call: Call) -> Spoiled | None:
    """After the first five calls twenty fail."""
    return Spoiled((500, 502, 503, 529)[call.number % 4]) if 5 < call.number <= 25 else None


def hanging(call: Call) -> Spoiled | None:
    """Three calls, one of them the first, get no answer."""
    return Spoiled(hang_s=3 * READ_TIMEOUT_S) if call.number in (1, 9, 10) else None


def mangled(call: Call) -> Spoiled | None:
    """Every second of the first forty answers is no answer."""
    half = call.reply[: len(call.reply) // 2]
    bodies = (call.reply, b"", b"<html>Gateway</html>", half, b"[]", b'{"choices": []}', b"\xff\xfe\0")
    kind = call.number // 2 % len(bodies)
    return Spoiled(body=bodies[kind], cut=kind == 0) if call.number <= 40 and call.number % 2 == 0 else None


def babbling(call: Call) -> Spoiled | None:
    """Every third first answer says something that nobody asked."""
    found = json.loads(call.reply)
    texts = ("I cannot say.", "7", "", "```json\n{", "0 1 0 1", "\u202e0")
    found["choices"][0]["message"]["content"] = texts[call.number // 3 % len(texts)]
    return Spoiled(body=json.dumps(found).encode()) if call.number % 3 == 0 and not call.again else None


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(storm, marks=pytest.mark.chaos("429 storm")),
        pytest.param(burst, marks=pytest.mark.chaos("5xx burst")),
        pytest.param(hanging, marks=pytest.mark.chaos("hung connection")),
        pytest.param(mangled, marks=pytest.mark.chaos("malformed output"), id="no completion"),
        pytest.param(babbling, marks=pytest.mark.chaos("malformed output"), id="unreadable text"),
    ],
)
def test_run_with_a_server_that_fails_for_a_while_ends_with_the_rows_of_a_good_day(
    make: Callable[..., JobConfig], server: FaultyServer, whole: Rows, measured: Measured, fault: Fault
) -> None:
    server.fault = fault
    job = make("hurt")
    assert measured.run(lambda: submit(job, steps=STEPS)) is None
    measured.compare(job.output, whole)
    measured.sent_twice = server.sent_twice
    assert server.spoiled.total() >= 3
    assert server.sent_twice == 0, "what was answered is not paid for again"
    measured.note = f"{server.spoiled.total()} of {server.sent} calls spoiled"


@pytest.mark.chaos("Retry-After 1 h")
def test_server_that_asks_for_an_hour_gets_an_hour_also_from_later_sessions(
    make: Callable[..., JobConfig],
    server: FaultyServer,
    whole: Rows,
    measured: Measured,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refused = list[int]()

    def fault(call: Call) -> Spoiled | None:
        if call.number < 12:
            return None
        refused.append(call.number)
        return Spoiled(429, (f"Retry-After: {HOUR_S:g}",))

    server.fault = fault
    jumped_s = [0.0]
    clock = partial(open_admissions, wall_clock=lambda: time.time() + sum(jumped_s))
    monkeypatch.setattr(limiter, "open_admissions", clock)
    job = make("hurt", workers={"timeout_s": 1.0, "retries": 0})
    assert measured.run(lambda: submit(job, steps=STEPS)) is None
    assert 0 < len(refused) <= CONCURRENCY, "only what was under way"
    server.fault, sent = None, server.sent

    def again() -> None:
        for error in {row["reason"].partition(":")[0] for row in answers(job.output) if row["status"] == "failed"}:
            retry(job.output, error=error)
        resume(job.output, steps=STEPS)

    for later_s in (0.0, HOUR_S - 60):
        jumped_s.append(later_s)
        again()
        assert server.sent == sent, "no call before its time"
    jumped_s.append(120)
    again()
    measured.compare(job.output, whole)
    measured.sent_twice = server.sent_twice
    assert server.sent_twice == 0
    measured.note = "no call in two resumed sessions before the hour was over"


@pytest.mark.chaos("bad key")
def test_refused_key_stops_the_run_and_is_nowhere_on_disk(
    make: Callable[..., JobConfig], server: FaultyServer, whole: Rows, measured: Measured
) -> None:
    server.fault = lambda call: Spoiled(401, body=f'{{"error": {{"message": "bad key {KEY}"}}}}'.encode())
    job = make("hurt")
    error = measured.run(lambda: submit(job, steps=STEPS))
    assert error is not None
    assert measured.exits == [1]
    assert KEY not in str(error)
    assert server.sent <= CONCURRENCY
    tried, server.fault = server.sent, None
    assert resume(job.output, steps=STEPS).driven.complete
    for path in Path(job.output).rglob("*"):
        assert not path.is_file() or KEY.encode() not in path.read_bytes(), path
    measured.compare(job.output, whole)
    measured.sent_twice = server.sent_twice
    assert server.sent_twice == 0
    measured.note = f"{tried} calls tried, nothing charged; the key is in no file"


@pytest.mark.chaos("stored reply damaged")
def test_damaged_stored_replies_are_asked_again_and_no_others(
    make: Callable[..., JobConfig], server: FaultyServer, whole: Rows, measured: Measured
) -> None:
    stored = sorted(Path(make("whole").calls_folder()).glob("??/*.json"))
    assert len(stored) == SENT
    draw = random.Random(0)
    for path in stored[::3]:
        data = bytearray(path.read_bytes())
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        path.write_bytes(bytes(data[: draw.choice((len(data), len(data) // 2))]))
    job = make("again", calls=make("whole").calls_folder())
    assert measured.run(lambda: submit(job, steps=STEPS)) is None
    measured.compare(job.output, whole)
    assert server.sent <= len(stored[::3])
    assert len(read_table(job.output, "answers")) == len(TEXTS)
    measured.sent_twice = server.sent - len(server.asked)
    measured.note = f"{len(stored[::3])} of {SENT} replies damaged, {server.sent} asked again"
