from __future__ import annotations

import asyncio

import pytest

from pipeline.models.messages import Reply, Request
from pipeline.query.evidence import Evidence, EvidenceConfig, find_evidence
from schemas.errors import QuestionError, StopError
from schemas.questions import Question, Task
from tests.query.tiny import Scripted, caller_of

VOCABULARY = ("sofa", "chair", "lamp", "table")


def _question(task: Task = "eqa") -> Question:
    return Question("q", "tiny", task, "Where can I sit?")


def _ask(client: Scripted, task: Task = "eqa", vocabulary: tuple[str, ...] = VOCABULARY) -> Evidence:
    return asyncio.run(find_evidence(_question(task), vocabulary, caller_of(client), EvidenceConfig()))


def test_eqa_keeps_three_names_in_the_order_of_the_reply() -> None:
    found = _ask(Scripted({"evidence": "sofa\nchair\ntable\nlamp"}))
    assert (found.status, found.categories) == ("answered", ("sofa", "chair", "table"))
    assert len(found.calls) == 1
    assert found.seconds > 0


@pytest.mark.parametrize("task", ["ground_one", "ground_many"])
def test_grounding_keeps_one_name(task: Task) -> None:
    assert _ask(Scripted({"evidence": "sofa\nchair"}), task).categories == ("sofa",)


def test_model_is_offered_the_sorted_names_and_k() -> None:
    client = Scripted({"evidence": "sofa"})
    _ask(client)
    assert client.requests[0].variables["categories"] == ["chair", "lamp", "sofa", "table"]
    assert client.requests[0].variables["k"] == 3


def test_none_is_skipped_with_a_reason() -> None:
    found = _ask(Scripted({"evidence": "none"}))
    assert (found.status, found.categories) == ("skipped", ())
    assert found.reason
    assert len(found.calls) == 1


def test_a_reply_without_known_names_is_asked_again_then_unparsed() -> None:
    client = Scripted({"evidence": "perhaps something soft"})
    found = _ask(client)
    assert (found.status, found.categories) == ("unparsed", ())
    assert client.count("evidence") == 2
    assert [row.outcome for row in found.calls] == ["unparsed", "unparsed"]


def test_a_scene_without_categories_fails_and_nothing_is_asked() -> None:
    client = Scripted({})
    found = _ask(client, vocabulary=())
    assert (found.status, found.calls) == ("failed", ())
    assert not client.requests


class _Refusing(Scripted):
    def __init__(self, error: Exception) -> None:
        super().__init__({})
        self.error = error

    async def complete(self, request: Request) -> Reply:
        raise self.error


def test_a_refused_question_is_failed_and_its_call_recorded() -> None:
    found = _ask(_Refusing(QuestionError("content policy")))
    assert (found.status, found.categories) == ("failed", ())
    assert "content policy" in found.reason
    assert [row.outcome for row in found.calls] == ["QuestionError"]


def test_an_error_that_ends_the_run_is_not_swallowed() -> None:
    with pytest.raises(StopError):
        _ask(_Refusing(StopError("bad key")))
