from __future__ import annotations

import asyncio

import pytest

from pipeline.models.messages import Reply, Request
from pipeline.models.replies import parse_text
from pipeline.query.ask_all import ask_all
from schemas.calls import CallRow
from schemas.errors import QuestionError, StopError
from schemas.questions import Question
from tests.query.tiny import Scripted, caller_of

QUESTION = Question("q", "tiny", "eqa", "What?")


class Slow(Scripted):
    """Replies with the number in the question, lower numbers later; fails on some."""

    def __init__(self, failures: dict[int, Exception]) -> None:
        super().__init__({})
        self.failures = failures
        self.under_way = self.most_under_way = self.ended = 0

    async def complete(self, request: Request) -> Reply:
        number = int(request.variables["candidates"][0])
        self.under_way += 1
        self.most_under_way = max(self.most_under_way, self.under_way)
        for _ in range(10 - number):
            await asyncio.sleep(0)
        self.under_way -= 1
        self.ended += 1
        if number in self.failures:
            raise self.failures[number]
        return Reply(f"reply {number}")


def _ask(client: Slow, count: int, calls: list[CallRow]) -> list[str | None]:
    async def run() -> list[str | None]:
        caller = caller_of(client)
        asks = [
            caller.ask(
                "choice",
                {"question": "?", "candidates": [str(number)]},
                (),
                parse_text,
                question=QUESTION,
                subject=str(number),
            )
            for number in range(count)
        ]
        return await ask_all(asks, calls)

    return asyncio.run(run())


def test_values_and_rows_keep_the_order_of_asking_whatever_ends_first() -> None:
    client, calls = Slow({}), []
    assert _ask(client, 6, calls) == [f"reply {n}" for n in range(6)]
    assert [row.subject for row in calls] == list("012345")
    assert client.most_under_way == 6


def test_the_first_error_in_order_is_raised_after_all_have_ended() -> None:
    client, calls = Slow({1: QuestionError("refused"), 4: StopError("bad key")}), []
    with pytest.raises(QuestionError, match="refused"):
        _ask(client, 6, calls)
    assert client.ended == 6
    assert [(row.subject, row.outcome) for row in calls] == [
        ("0", "ok"),
        ("1", "QuestionError"),
        ("2", "ok"),
        ("3", "ok"),
        ("4", "StopError"),
        ("5", "ok"),
    ]


def test_nothing_asked_gives_nothing() -> None:
    assert _ask(Slow({}), 0, []) == []
