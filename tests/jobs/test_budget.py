"""A run's caps: it ends cleanly at them, goes on with higher ones, and no call is paid twice by any process."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from jobs.runs.results import RESULTS
from jobs.runs.submit import resume, submit
from schemas.errors import StopError
from schemas.run_folder import read_table
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.models.counting_server import CountingServer
from tests.workers.calling_steps import CALLS, STEPS

pytestmark = pytest.mark.filterwarnings(
    # Ray leaves the sockets and pipes of its own processes to the garbage collector.
    "ignore::ResourceWarning",
    "ignore::pytest.PytestUnraisableExceptionWarning",
)

TEXTS = [f"question {number}" for number in range(12)]
SENT = len(TEXTS) * (CALLS - 1) + 1
"""Different calls of all questions."""


@pytest.fixture
def server() -> Iterator[CountingServer]:
    with CountingServer(delay_s=0.02) as found:
        yield found


def models(server: CountingServer, **fields: Any) -> dict[str, Any]:
    endpoint = {"kind": "openai", "base_url": server.base_url, "model": "m", "max_tokens": 50, **fields}
    return {"endpoints": {"e": endpoint}, "default": "e"}


def result_bytes(run: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(Path(run, RESULTS).iterdir())}


def journal_of(job: JobConfig) -> list[dict[str, Any]]:
    (path,) = Path(job.calls_folder(), "journals").rglob("*.jsonl")
    return [json.loads(line) for line in path.read_text().splitlines() if line]


@pytest.mark.chaos("budget reached")
def test_a_cap_ends_the_run_and_a_higher_one_finishes_it(
    make_scene: Callable[..., Path], make_job: MakeJob, server: CountingServer, measured: Measured
) -> None:
    make_scene("a", TEXTS)
    whole = submit(make_job("whole", models=models(server)), steps=STEPS)
    paid = server.sent
    assert paid == SENT
    job = make_job(models=models(server), budget={"calls": 15})
    measured.struck()
    with pytest.raises(StopError, match=r"15 of 15 calls spent.*--max-calls: splatreasoner resume"):
        submit(job, steps=STEPS)
    measured.ended(1)
    assert server.sent - paid == 15
    with pytest.raises(StopError, match="--max-calls"):
        resume(job.output, steps=STEPS)
    assert server.sent - paid == 15
    ended = resume(job.output, steps=STEPS, budget={"calls": 1000})
    assert ended.driven.complete
    assert result_bytes(job.output) == result_bytes(whole.run)
    assert server.sent - paid == SENT, "what was paid for below the cap is not paid for again"
    measured.compare(job.output, whole.run)
    measured.sent_twice, measured.note = 0, "15 calls sent at a cap of 15"


def test_actors_of_a_run_pay_once_for_what_several_ask_and_share_one_limit(
    make_scene: Callable[..., Path], make_job: MakeJob, server: CountingServer, capfd: pytest.CaptureFixture[str]
) -> None:
    make_scene("a", TEXTS)
    workers = {"in_process": False, "model_actors": 2, "questions_in_flight": len(TEXTS)}
    job = make_job(models=models(server, concurrency=3), workers=workers, budget={"tokens": 10**9})
    assert submit(job, steps=STEPS).driven.complete
    assert set(server.asked.values()) == {1}
    assert server.sent == SENT
    assert server.most_under_way <= 3
    calls = read_table(job.output, "calls")
    assert (~calls["cached"]).sum() == SENT
    sent = calls[~calls["cached"]]
    assert (sent["prompt_tokens"] + sent["completion_tokens"]).sum() == server.sent_tokens
    lines = journal_of(job)
    assert sum(line["tokens"] for line in lines if "done" in line) == server.sent_tokens
    assert len([line for line in lines if "sent" in line]) - len([line for line in lines if "unsent" in line]) == SENT
    assert "core_worker" not in capfd.readouterr().err  # Ray would warn of an actor it cannot start again


def test_a_cap_on_money_needs_prices(server: CountingServer, make_job: MakeJob) -> None:
    with pytest.raises(ValueError, match="usd_per_million_prompt"):
        make_job(models=models(server), budget={"usd": 1.0})
    prices = {"usd_per_million_prompt": 1.0, "usd_per_million_completion": 2.0}
    assert make_job(models=models(server, **prices), budget={"usd": 1.0}).budget.usd == 1.0


def test_caps_change_no_unit(make_scene: Callable[..., Path], make_job: MakeJob, server: CountingServer) -> None:
    from jobs.runs.plan import plan_units

    make_scene("a", TEXTS)
    plans = [plan_units(make_job(models=models(server), budget=budget)) for budget in ({}, {"calls": 3})]
    assert [unit.id for unit in plans[0]] == [unit.id for unit in plans[1]]


def test_replay_answers_from_stored_replies_without_network_or_key(
    make_scene: Callable[..., Path], make_job: MakeJob, server: CountingServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_scene("a", TEXTS)
    monkeypatch.setenv("SOME_KEY", "k")
    asked = models(server, key_env="SOME_KEY")
    first = make_job("first", models=asked)
    submit(first, steps=STEPS)
    monkeypatch.delenv("SOME_KEY")
    again = make_job("again", models=asked, cache="replay", calls=first.calls_folder())
    assert submit(again, steps=STEPS).driven.complete
    assert result_bytes(again.output) == result_bytes(first.output)
    assert server.sent == SENT

    stored = next(Path(first.calls_folder()).glob("??/*.json"))
    stored.unlink()
    lacking = make_job("lacking", models=asked, cache="replay", calls=first.calls_folder())
    driven = submit(lacking, steps=STEPS).driven
    assert driven.failed >= 1
    reasons = set(read_table(lacking.output, "answers")["reason"]) - {""}
    assert reasons == {f"QuestionError: replay: no reply is stored for the verify call {stored.stem}"}
    assert server.sent == SENT


def test_without_the_cache_nothing_is_read_or_written(
    make_scene: Callable[..., Path], make_job: MakeJob, server: CountingServer
) -> None:
    make_scene("a", TEXTS[:2])
    for name in ("one", "two"):
        job = make_job(
            name, models=models(server), cache="off", calls=str(Path(make_job(name).output).parent / "calls")
        )
        assert submit(job, steps=STEPS).driven.complete
    assert not list(Path(job.calls_folder()).glob("??/*.json"))
    assert {count for count in server.asked.values()} >= {2}
