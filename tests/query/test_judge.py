from __future__ import annotations

import asyncio

import numpy as np

from pipeline.models.messages import ImagePart
from pipeline.query.judge import Choice, answer_views, choose_views
from schemas.calls import CallRow
from schemas.questions import Question
from tests.query.tiny import Scripted, caller_of

QUESTION = Question("q", "tiny", "eqa", "What is on the table?")


def _choose(client: Scripted, groups: list[list[str | None]]) -> tuple[list[Choice], list[CallRow]]:
    calls: list[CallRow] = []
    return asyncio.run(choose_views(QUESTION, groups, caller_of(client), calls)), calls


def _image(shade: int) -> ImagePart:
    return ImagePart(np.full((2, 2, 3), shade, np.uint8))


def test_every_view_is_answered_alone_in_order() -> None:
    client = Scripted({"view_answer": lambda request: f"shade {request.images()[0].color[0, 0, 0]}"})
    calls: list[CallRow] = []
    images = [_image(shade) for shade in (7, 5, 9)]
    answers = asyncio.run(answer_views(QUESTION, images, ["a", "b", "c"], caller_of(client), calls))
    assert answers == ["shade 7", "shade 5", "shade 9"]
    assert [row.subject for row in calls] == ["a", "b", "c"]
    assert all(len(request.images()) == 1 for request in client.requests)
    assert all(request.variables["question"] == QUESTION.question for request in client.requests)


def test_blank_view_answer_is_none() -> None:
    client = Scripted({"view_answer": "  "})
    calls: list[CallRow] = []
    assert asyncio.run(answer_views(QUESTION, [_image(1)], ["a"], caller_of(client), calls)) == [None]
    assert [row.outcome for row in calls] == ["unparsed", "unparsed"]


def test_choice_is_made_from_texts_alone_for_each_cluster() -> None:
    client = Scripted({"choice": lambda request: "2" if "cup" in request.variables["candidates"][0] else "0"})
    choices, calls = _choose(client, [["a cup", "nothing", "a red cup"], ["a vase", "a blue vase"]])
    assert choices == [Choice(2), Choice(0)]
    assert [row.subject for row in calls] == ["cluster 0", "cluster 1"]
    assert not any(request.images() for request in client.requests)


def test_equal_answers_keep_the_initial_view_and_ask_nothing() -> None:
    client = Scripted({})
    choices, _ = _choose(client, [["a cup"] * 5, ["only one"]])
    assert choices == [Choice(0), Choice(0)]
    assert not client.requests


def test_candidates_without_an_answer_take_no_part() -> None:
    client = Scripted({"choice": "1"})
    choices, _ = _choose(client, [[None, "a cup", None, "a red cup"], [None, "same", "same"]])
    assert choices == [Choice(3), Choice(1)]
    assert client.requests[0].variables["candidates"] == ["a cup", "a red cup"]
    assert client.count("choice") == 1


def test_a_cluster_without_any_answer_has_no_choice_and_a_reason() -> None:
    choices, _ = _choose(Scripted({}), [[None, None]])
    assert choices[0].candidate is None
    assert "cluster 0" in choices[0].reason


def test_an_unreadable_choice_is_none_with_a_reason() -> None:
    client = Scripted({"choice": "the second one, I think, or the third"})
    choices, calls = _choose(client, [["a", "b"]])
    assert choices[0].candidate is None
    assert "could not be read" in choices[0].reason
    assert len(calls) == 2
