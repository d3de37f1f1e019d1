"""Caller, gate and client against a server that fails in every way: the strict verdict of llmock on how they behave."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pytest
from llmock.pytest_plugin import LLMock

from pipeline.models.budget import BudgetConfig
from pipeline.models.caller import Asked, Caller
from pipeline.models.clients import make_caller
from pipeline.models.config import EndpointConfig, ModelConfig
from pipeline.models.gate import Gate, LocalAuthority
from pipeline.models.replies import parse_index
from pipeline.models.traffic import open_admissions
from schemas.errors import QuestionError, StopError
from schemas.questions import Question
from tests.models.mangling_proxy import FAULTS, ManglingProxy

T = TypeVar("T")
QUESTION = Question("q1", "flat", "eqa", "Where is the lamp?")
CALLS = 30


@pytest.fixture
def server(llmock: LLMock) -> LLMock:
    return llmock.reply("1", times=None)


async def ask(caller: Caller, name: str) -> Asked[int]:
    variables = {"question": QUESTION.question, "candidates": [name, "b"]}
    return await caller.ask("verify", variables, (), partial(parse_index, count=2), question=QUESTION)


async def ask_many(folder: Path, base_url: str, count: int = CALLS, **endpoint: Any) -> list[Asked[int]]:
    """Ask different things at once, through a gate."""
    fields = {"kind": "openai", "base_url": base_url, "model": "m", "max_tokens": 20, "read_timeout_s": 1.0, **endpoint}
    retry = {"first_wait_s": 0.4, "max_wait_s": 1.6, "max_tries": 8}
    models = ModelConfig(endpoints={"e": EndpointConfig.model_validate(fields)}, default="e", retry=retry)
    admission = open_admissions(models, BudgetConfig(), folder / "journals", "s")["e"]
    caller = make_caller(models, folder / "calls", {"e": Gate(LocalAuthority(admission))})
    try:
        return list(await asyncio.gather(*(ask(caller, f"question {number}") for number in range(count))))
    finally:
        await caller.aclose()


def run(coroutine: Coroutine[Any, Any, T]) -> T:
    return asyncio.run(coroutine)


def test_rate_limits_with_a_wait_are_kept_to_the_second(server: LLMock, tmp_path: Path) -> None:
    server.reset().rate_limit(times=4, retry_after=1.2).reply("1", times=None)
    asked = run(ask_many(tmp_path, server.base_url()))
    assert [one.value for one in asked] == [1] * CALLS
    assert sum(row.outcome == "RateLimitError" for one in asked for row in one.rows) == 4
    server.assert_resilient(strict=True)


@pytest.mark.parametrize("status", [500, 502, 503, 529, 408])
def test_bursts_of_failures_that_pass_are_tried_again_with_growing_waits(
    server: LLMock, tmp_path: Path, status: int
) -> None:
    server.reset().fail(status, times=12).reply("1", times=None)
    assert [one.value for one in run(ask_many(tmp_path, server.base_url(), 6))] == [1] * 6
    server.assert_resilient(strict=True)


def test_hangs_end_at_the_read_timeout(server: LLMock, tmp_path: Path) -> None:
    server.reset().delay(3.0, times=3).reply("1", times=None)
    asked = run(ask_many(tmp_path, server.base_url(), 6, read_timeout_s=0.5))
    assert [one.value for one in asked] == [1] * 6
    assert sum(row.outcome == "LostReplyError" for one in asked for row in one.rows) == 3
    server.assert_resilient(strict=True)


@pytest.mark.parametrize(("status", "error"), [(400, QuestionError), (422, QuestionError), (401, StopError)])
def test_failures_that_last_are_sent_once(server: LLMock, tmp_path: Path, status: int, error: type[Exception]) -> None:
    server.reset().fail(status, times=None)
    with pytest.raises(error):
        run(ask_many(tmp_path, server.base_url(), 1))
    assert len(server.requests) == 1
    server.assert_resilient(strict=True)


def test_an_exhausted_quota_stops_at_once(server: LLMock, tmp_path: Path) -> None:
    server.reset().fail(429, code="insufficient_quota", times=None)
    with pytest.raises(StopError):
        run(ask_many(tmp_path, server.base_url(), 1))
    assert len(server.requests) == 1


def test_a_real_quota_is_met_without_a_storm(server: LLMock, tmp_path: Path) -> None:
    server.limits(rpm=300)  # refills five a second; the bucket begins full
    count = 310
    asked = run(ask_many(tmp_path, server.base_url(), count, concurrency=16))
    assert len(asked) == count
    server.assert_resilient(strict=True)


def test_spoiled_replies_are_asked_again_and_none_is_taken(server: LLMock, tmp_path: Path) -> None:
    async def main() -> tuple[list[Asked[int]], ManglingProxy]:
        async with ManglingProxy(server.url) as proxy:
            return await ask_many(tmp_path, f"{proxy.url}/v1", 60), proxy

    asked, proxy = run(main())
    assert [one.value for one in asked] == [1] * 60
    assert {fault for fault in FAULTS if proxy.faults[fault]} == set(FAULTS)
    rows = [row for one in asked for row in one.rows]
    assert {row.outcome for row in rows} == {"ok", "LostReplyError"}
    assert sum(row.outcome == "LostReplyError" for row in rows) == proxy.faults.total()
    server.assert_resilient(strict=True)
