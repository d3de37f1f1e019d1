"""Token estimates: what they count and how a server's own count raises them."""

from __future__ import annotations

import json

import pytest

from pipeline.models.estimate import BYTES_PER_TOKEN, Price, TokenEstimate
from pipeline.models.messages import Message, Reply, Request
from pipeline.models.reply_schemas import response_format, schema_note

EVIDENCE = Request(
    "evidence", (Message("user", ("Which?",)),), {"categories": [f"thing {number}" for number in range(200)]}
)


def _most(structured: str, request: Request = EVIDENCE) -> int:
    return TokenEstimate(800, 50, Price(), structured).most(request)[0]


@pytest.mark.parametrize("structured", ["json_schema", "json_object"])
def test_the_form_asked_of_a_reply_counts_with_its_note(structured: str) -> None:
    sent = json.dumps(response_format(EVIDENCE, structured)) + schema_note(EVIDENCE)
    assert _most(structured) - _most("none") == pytest.approx(len(sent) / BYTES_PER_TOKEN, abs=1)


def test_free_text_has_no_form_to_count() -> None:
    request = Request("caption", (Message("user", ("Describe it.",)),))
    assert _most("json_schema", request) == _most("none", request)


def test_a_count_above_the_estimate_raises_those_that_follow() -> None:
    estimate = TokenEstimate(800, 50, Price(), "json_schema")
    before = estimate.most(EVIDENCE)[0] - 50
    estimate.learn(EVIDENCE, Reply("x", 2 * before, 1))
    assert estimate.most(EVIDENCE)[0] - 50 >= 2 * before
    estimate.learn(EVIDENCE, Reply("x", 1, 1))
    assert estimate.most(EVIDENCE)[0] - 50 >= 2 * before
