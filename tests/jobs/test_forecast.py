"""A forecast says, from some questions, what a run of all then takes; nothing is sent for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from jobs.forecast import forecast
from jobs.submit import submit
from pipeline.models.caller import Caller, Toll
from pipeline.models.config import STAGES
from pipeline.models.estimate import TokenEstimate
from pipeline.models.messages import Reply, Request
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from schemas.question_file import load_questions, save_questions
from schemas.run_folder import read_table
from tests.jobs.test_end_to_end import apartment as apartment
from workers.method_steps import METHOD_STEPS
from workers.steps import Work

IMAGE_TOKENS = 300
SHARE = 0.15
"""What the forecast may be off by."""
ENDPOINT = {
    "kind": "openai",
    "base_url": "http://127.0.0.1:9/v1",
    "model": "m",
    "key_env": "A_KEY_NOBODY_SET",
    "image_tokens": IMAGE_TOKENS,
    "usd_per_million_prompt": 2.0,
    "usd_per_million_completion": 8.0,
    "requests_per_min": 30,
}


class MeteredModel:
    """The symbolic model as a server would bill it: four bytes a token, a fixed number a picture."""

    name = "e:m"

    def __init__(self) -> None:
        self._symbolic = SymbolicModel()

    def identity(self) -> Mapping[str, Any]:
        return {"kind": "metered"}

    async def complete(self, request: Request) -> Reply:
        reply = await self._symbolic.complete(request)
        text = "".join(part for message in request.messages for part in message.parts if isinstance(part, str))
        prompt = len(text.encode()) // 4 + IMAGE_TOKENS * len(request.images())
        return Reply(reply.text, prompt, max(1, len(reply.text.encode()) // 4))


def metered_caller(work: Work, gates: Mapping[str, Any]) -> Caller:
    endpoint = work.models.endpoints["e"]
    toll = Toll(None, TokenEstimate(IMAGE_TOKENS, 100, endpoint.price), endpoint.price)
    return Caller(dict.fromkeys(STAGES, MeteredModel()), Prompts.load(), None, tolls={"e": toll})


def test_forecast_is_within_its_share_of_what_the_run_takes(
    apartment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    questions = tmp_path / "some.jsonl"
    found = load_questions(Path(apartment, "questions.jsonl"))
    save_questions(found, questions)
    job = JobConfig.model_validate(
        {
            "name": "metered",
            "output": str(tmp_path / "run"),
            "scenes": apartment,
            "questions": str(questions),
            "models": {"endpoints": {"e": ENDPOINT}, "default": "e"},
            "workers": {"in_process": True},
        }
    )
    said = forecast(job, sample=len(found) // 2)
    assert said.sampled < said.questions == len(found)
    monkeypatch.setenv("A_KEY_NOBODY_SET", "now someone did")
    run = submit(job, steps=replace(METHOD_STEPS, make_caller=metered_caller)).run
    calls = read_table(run, "calls")
    assert sum(s.calls for s in said.stages) == pytest.approx(len(calls), rel=SHARE)
    tokens = calls["prompt_tokens"].sum() + calls["completion_tokens"].sum()
    assert sum(s.prompt_tokens + s.completion_tokens for s in said.stages) == pytest.approx(tokens, rel=SHARE)
    assert sum(s.usd or 0 for s in said.stages) == pytest.approx(calls["usd"].sum(), rel=SHARE)
    assert said.model_s["e"] == pytest.approx(len(calls) / 30 * 60, rel=SHARE)
