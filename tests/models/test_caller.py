"""The caller: retries by error type, asking again, the cache before use, one payment for one request, rows for all."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.budget import BudgetConfig
from pipeline.models.cache import CallCache
from pipeline.models.caller import Asked, Caller, Toll, rows_of
from pipeline.models.estimate import Price, TokenEstimate
from pipeline.models.gate import Gate
from pipeline.models.messages import Reply, Request, text_of
from pipeline.models.prompts import Prompts
from pipeline.models.replies import parse_index
from pipeline.models.retry import RetryPolicy
from schemas.calls import CallRow
from schemas.errors import (
    InputError,
    LostReplyError,
    QuestionError,
    RateLimitError,
    RetryError,
    SplatReasonerError,
    StopError,
    UnreachableError,
)
from schemas.questions import Question
from tests.models.simulated_loop import simulate
from tests.models.test_gate import authority

PROMPTS = Prompts.load()
QUESTION = Question("q1", "flat", "eqa", "Where is the lamp?")
VARIABLES = {"question": QUESTION.question, "candidates": ["a", "b"]}


class FakeClient:
    """Plays back replies and errors, and keeps the requests."""

    name = "local:m-1"

    def __init__(self, *script: str | Exception) -> None:
        self.script, self.requests = list(script), list[Request]()
        self.gate: asyncio.Event | None = None

    def identity(self) -> Mapping[str, Any]:
        return {"kind": "fake", "model": "m-1"}

    async def complete(self, request: Request) -> Reply:
        self.requests.append(request)
        step = self.script.pop(0)
        if self.gate is not None:
            await self.gate.wait()
        if isinstance(step, Exception):
            raise step
        return Reply(step, 10, 2)


class Time:
    """A clock that moves only when someone sleeps."""

    def __init__(self) -> None:
        self.now, self.sleeps = 0.0, list[float]()

    async def sleep(self, seconds: float) -> None:
        self.sleeps.append(seconds)
        self.now += seconds

    def clock(self) -> float:
        return self.now


def _caller(client: FakeClient, cache: CallCache | None = None, time: Time | None = None, **options: Any) -> Caller:
    time = time or Time()
    return Caller({"choice": client}, PROMPTS, cache, sleep=time.sleep, clock=time.clock, **options)


def _parse(text: str) -> int | None:
    return parse_index(text, 2)


def _ask(caller: Caller, parse: Callable[[str], int | None] = _parse, **changed: Any) -> Asked[int]:
    return asyncio.run(_asking(caller, parse, **changed))


async def _asking(caller: Caller, parse: Callable[[str], int | None] = _parse, **changed: Any) -> Asked[int]:
    return await caller.ask("choice", {**VARIABLES, **changed}, (), parse, question=QUESTION, subject="cluster 0")


def _outcomes(rows: Sequence[Any]) -> list[tuple[str, int, bool]]:
    return [(row.outcome, row.attempt, row.cached) for row in rows]


def test_ask_readable_reply_is_one_row_with_all_it_cost() -> None:
    asked = _ask(_caller(FakeClient("1")))
    assert (asked.value, asked.text) == (1, "1")
    (row,) = asked.rows
    assert (row.question_id, row.scene, row.stage, row.subject) == ("q1", "flat", "choice", "cluster 0")
    assert (row.endpoint, row.model, row.outcome, row.reply) == ("local", "m-1", "ok", "1")
    assert (row.prompt_tokens, row.completion_tokens, row.cached) == (10, 2, False)
    assert row.prompt_sha256 == PROMPTS.sha256("choice")
    assert len(row.key) == 64


def test_rows_hold_the_text_of_their_own_request() -> None:
    client = FakeClient("the first", RetryError("busy"), "0")
    rows = _ask(_caller(client)).rows
    first, second = (text_of(client.requests[place].messages) for place in (0, 1))
    assert [row.prompt for row in rows] == [first, second, second]
    assert "Where is the lamp?" in first, "filled in"
    assert second.startswith(first)
    assert "\n=== assistant ===\nthe first\n=== user ===\n" in second


def test_rows_hold_no_text_where_none_is_to_be_kept_and_keys_do_not_depend_on_it() -> None:
    without, kept = (_ask(_caller(FakeClient("0"), keep_prompts=keep)).rows for keep in (False, True))
    assert without[0].prompt == ""
    assert without[0].key == kept[0].key


def test_ask_unreadable_reply_is_asked_again_with_another_request() -> None:
    client = FakeClient("the first", "0")
    asked = _ask(_caller(client))
    assert asked.value == 0
    assert _outcomes(asked.rows) == [("unparsed", 1, False), ("ok", 2, False)]
    assert asked.rows[0].key != asked.rows[1].key
    assert [m.role for m in client.requests[1].messages[-2:]] == ["assistant", "user"]
    assert client.requests[1].messages[-2].parts == ("the first",)


def test_ask_tries_that_sent_nothing_take_nothing_from_the_budget() -> None:
    """Without an endpoint, six tries would reach a cap of one call, and the run would end for the wrong reason."""

    async def run(client: FakeClient) -> tuple[CallRow, ...]:
        gate = Gate(authority(caps=BudgetConfig(calls=1)))
        toll = Toll(gate, TokenEstimate(0, 10, Price()), None)
        caller = _caller(client, tolls={"local": toll})
        try:
            return (await _asking(caller)).rows
        except SplatReasonerError as error:
            return rows_of(error)

    def outcomes(*script: str | Exception) -> list[str]:
        return [row.outcome for row in simulate(run(FakeClient(*script)))]

    assert outcomes(*[UnreachableError("refused")] * 3, "0") == ["UnreachableError"] * 3 + ["ok"]
    assert outcomes(LostReplyError("cut"), "0") == ["LostReplyError"], "it may have been billed: the cap is reached"


@pytest.mark.parametrize("max_asks", [1, 2, 4])
def test_ask_stays_unreadable_gives_none_and_the_last_reply(max_asks: int) -> None:
    client = FakeClient(*[f"no {i}" for i in range(9)])
    asked = _ask(_caller(client, max_asks=max_asks))
    assert asked.value is None
    assert asked.text == f"no {max_asks - 1}"
    assert _outcomes(asked.rows) == [("unparsed", i + 1, False) for i in range(max_asks)]


def test_ask_falsy_values_are_values() -> None:
    assert _ask(_caller(FakeClient("0", "1"))).value == 0


def test_ask_passing_failures_are_tried_again_and_recorded() -> None:
    time = Time()
    client = FakeClient(RetryError("HTTP 500"), RateLimitError("slow down", 7.25), RateLimitError("slow down"), "1")
    asked = _ask(_caller(client, time=time))
    assert asked.value == 1
    assert [row.outcome for row in asked.rows] == ["RetryError", "RateLimitError", "RateLimitError", "ok"]
    assert asked.rows[0].reply == "HTTP 500"
    assert all(row.attempt == 1 for row in asked.rows)
    assert len({row.key for row in asked.rows}) == 1
    assert 0.5 <= time.sleeps[0] <= 1
    assert time.sleeps[1] == 7.25
    assert 2 <= time.sleeps[2] <= 4


def test_ask_passing_failures_end_after_max_tries_with_their_rows() -> None:
    time = Time()
    client = FakeClient(*[RetryError(f"try {i}") for i in range(9)])
    with pytest.raises(RetryError, match="try 3") as caught:
        _ask(_caller(client, time=time, retry=RetryPolicy(max_tries=4)))
    assert [row.reply for row in rows_of(caught.value)] == [f"try {i}" for i in range(4)]
    assert len(time.sleeps) == 3


def test_ask_wait_beyond_the_bound_is_not_waited_for() -> None:
    time = Time()
    with pytest.raises(RateLimitError):
        _ask(_caller(FakeClient(RateLimitError("tomorrow", 86_400.0)), time=time))
    assert time.sleeps == []


@pytest.mark.parametrize("error", [QuestionError("too long"), StopError("bad key")])
def test_ask_lasting_failures_are_raised_at_once_with_their_row(error: Exception) -> None:
    client = FakeClient("no", error)
    with pytest.raises(type(error)) as caught:
        _ask(_caller(client))
    assert _outcomes(rows_of(caught.value)) == [("unparsed", 1, False), (type(error).__name__, 2, False)]


def test_ask_error_of_ours_is_not_swallowed() -> None:
    with pytest.raises(ZeroDivisionError):
        _ask(_caller(FakeClient("1")), lambda text: 1 // 0)
    assert rows_of(ZeroDivisionError()) == ()


def test_cache_second_run_sends_nothing_and_reads_the_same(tmp_path: Path) -> None:
    first = _ask(_caller(FakeClient("hm", "1"), CallCache(tmp_path)))
    client = FakeClient()
    second = _ask(_caller(client, CallCache(tmp_path)))
    assert client.requests == []
    assert (second.value, second.text) == (first.value, first.text)
    assert _outcomes(second.rows) == [("unparsed", 1, True), ("ok", 2, True)]
    assert [row.key for row in second.rows] == [row.key for row in first.rows]
    assert [row.prompt_tokens for row in second.rows] == [10, 10]
    assert [row.latency_s for row in second.rows] == [0, 0]


def test_cache_is_written_before_the_reply_is_used(tmp_path: Path) -> None:
    def parse(text: str) -> int:
        assert len(list(tmp_path.rglob("*.json"))) == 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _ask(_caller(FakeClient("1"), CallCache(tmp_path)), parse)
    assert _ask(_caller(FakeClient(), CallCache(tmp_path))).value == 1


def test_cache_failures_and_blank_replies_are_not_stored(tmp_path: Path) -> None:
    with pytest.raises(QuestionError):
        _ask(_caller(FakeClient(RetryError("x"), QuestionError("refused")), CallCache(tmp_path)))
    _ask(_caller(FakeClient(" ", ""), CallCache(tmp_path)))
    assert list(tmp_path.rglob("*.json")) == []


def test_cache_uncached_stage_stores_nothing(tmp_path: Path) -> None:
    assert _ask(_caller(FakeClient("1"), CallCache(tmp_path), uncached={"choice"})).value == 1
    assert list(tmp_path.rglob("*.json")) == []


def test_same_request_at_once_is_paid_once() -> None:
    async def both(client: FakeClient) -> list[Asked[int]]:
        client.gate = asyncio.Event()
        caller = _caller(client)
        tasks = [asyncio.create_task(_asking(caller)) for _ in range(3)]
        await asyncio.sleep(0.01)
        client.gate.set()
        return list(await asyncio.gather(*tasks))

    client = FakeClient("1", "0", "0")
    asked = asyncio.run(both(client))
    assert [a.value for a in asked] == [1, 1, 1]
    assert len(client.requests) == 1
    assert [a.rows[0].cached for a in asked] == [False, True, True]


@pytest.mark.parametrize("end", ["error", "cancel"])
def test_same_request_at_once_survives_the_first_one_ending(end: str) -> None:
    async def both(client: FakeClient) -> Asked[int]:
        client.gate = asyncio.Event()
        caller = _caller(client)
        first, second = asyncio.create_task(_asking(caller)), asyncio.create_task(_asking(caller))
        await asyncio.sleep(0.01)
        if end == "cancel":
            first.cancel()
        client.gate.set()
        with pytest.raises(asyncio.CancelledError if end == "cancel" else QuestionError):
            await first
        return await second

    client = FakeClient(QuestionError("no") if end == "error" else "0", "1")
    assert asyncio.run(both(client)).value == 1
    assert len(client.requests) == 2


def test_caller_is_usable_from_one_event_loop_after_another(tmp_path: Path) -> None:
    caller = _caller(FakeClient("1", "0"), CallCache(tmp_path))
    assert [_ask(caller, candidates=["a", str(i)]).value for i in range(2)] == [1, 0]


def test_caller_without_asks_raises() -> None:
    with pytest.raises(InputError, match="max_asks"):
        _caller(FakeClient(), max_asks=0)


@given(st.integers(1, 30), st.floats(0, 1), st.floats(0, 5), st.floats(0, 100))
def test_retry_policy_waits_are_bounded(tries: int, spread: float, first: float, longest: float) -> None:
    policy = RetryPolicy(max_tries=20, first_wait_s=first, max_wait_s=longest)
    wait = policy.wait_s(tries, RetryError("x"), spread)
    assert (wait is None) == (tries >= 20)
    assert wait is None or 0 <= wait <= min(longest, first * 2 ** (tries - 1)) * (1 + 1e-12)
