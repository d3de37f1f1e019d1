"""Claims: one holder a key among processes, freed by death; two runs that share a folder pay once."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
from functools import partial
from pathlib import Path

import pytest

from pipeline.models import claims as claims_module
from pipeline.models.budget import BudgetConfig
from pipeline.models.caller import Caller
from pipeline.models.claims import Claims
from pipeline.models.clients import make_caller
from pipeline.models.config import EndpointConfig, ModelConfig
from pipeline.models.gate import Gate, LocalAuthority
from pipeline.models.replies import parse_index
from pipeline.models.traffic import open_admissions
from schemas.questions import Question
from tests.models.counting_server import CountingServer

KEYS = ("a" * 64, "b" * 64)
CALLS = 200


def test_a_key_has_one_holder_and_others_have_theirs(tmp_path: Path) -> None:
    one, other = Claims(tmp_path / "log" / "claims"), Claims(tmp_path / "log" / "claims")
    assert one.take(KEYS[0])
    assert one.take(KEYS[0]), "its own"
    assert not other.take(KEYS[0])
    assert other.take(KEYS[1])
    other.free(KEYS[0])  # not its own to give up
    assert not other.take(KEYS[0])
    one.free(KEYS[0])
    assert other.take(KEYS[0])


def test_closing_gives_all_up_and_another_file_object_nothing(tmp_path: Path) -> None:
    one, other = Claims(tmp_path / "claims"), Claims(tmp_path / "claims")
    assert one.take(KEYS[0])
    (tmp_path / "claims").read_bytes()
    assert not other.take(KEYS[0])
    one.close()
    assert other.take(KEYS[0])


def _take_and_die(path: Path) -> None:
    held = Claims(path)
    assert held.take(KEYS[0])
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_claim_ends_with_its_process(tmp_path: Path) -> None:
    process = multiprocessing.get_context("spawn").Process(target=_take_and_die, args=(tmp_path / "claims",))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert Claims(tmp_path / "claims").take(KEYS[0])


def test_without_locks_everyone_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(*arguments: object) -> None:
        raise OSError(next(iter(claims_module.NO_LOCKS)), "no locks here")

    monkeypatch.setattr(claims_module.fcntl, "fcntl", no_locks)
    assert Claims(tmp_path / "claims").take(KEYS[0])
    assert Claims(tmp_path / "claims").take(KEYS[0])


async def _ask_all(caller: Caller) -> list[int]:
    question = Question("q", "s", "eqa", "Which?")
    parse = partial(parse_index, count=2)

    async def ask(number: int) -> int:
        asked = await caller.ask(
            "verify", {"question": "Which?", "candidates": [str(number), "b"]}, (), parse, question=question
        )
        return sum(not row.cached for row in asked.rows)

    try:
        return list(await asyncio.gather(*(ask(number) for number in range(CALLS))))
    finally:
        await caller.aclose()


def _run(folder: Path, base_url: str, name: str) -> list[int]:
    """Ask CALLS calls as a run of its own does, with its own limits; return how often each was paid for."""
    endpoint = EndpointConfig(kind="openai", base_url=base_url, model="m", max_tokens=20, concurrency=16)
    models = ModelConfig(endpoints={"e": endpoint}, default="e")
    admission = open_admissions(models, BudgetConfig(), folder / name, name)["e"]
    return asyncio.run(_ask_all(make_caller(models, folder / "calls", {"e": Gate(LocalAuthority(admission))})))


def test_two_runs_that_ask_the_same_at_once_pay_once_for_each(tmp_path: Path) -> None:
    with CountingServer(delay_s=0.02) as server, multiprocessing.get_context("spawn").Pool(2) as pool:
        paid = pool.starmap(_run, [(tmp_path, server.base_url, name) for name in ("one", "other")])
        assert server.sent == CALLS
        assert set(server.asked.values()) == {1}
    assert [sum(pair) for pair in zip(*paid, strict=True)] == [1] * CALLS
