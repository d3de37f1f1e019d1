"""A method that does nothing: what a run with it takes is orchestration. Its waits stand for models and stages."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from schemas.answers import AnswerRow, ArmRow
from schemas.calls import TimingRow
from schemas.questions import Question
from workers.index_steps import FoundIndex, Unstored
from workers.steps import Steps, Tables, Work

MODEL_S = float(os.environ.get("NULL_MODEL_S", "0"))
"""Mean seconds a question waits for models, exponentially spread."""
CPU_S = float(os.environ.get("NULL_CPU_S", "0"))
"""CPU seconds of a question's propose."""
PICTURE_BYTES = int(os.environ.get("NULL_PICTURE_BYTES", "0"))
"""Bytes of a question's candidate views."""
ARMS = ("initial", "final", "verified")


def load(uri: str) -> str:
    """Return nothing but the name."""
    return uri


def vocabulary(scene: str) -> tuple[str, ...]:
    """Return one category."""
    return ("thing",)


def prepare(scene: str) -> None:
    """Prepare nothing."""


def open_context(scene: str, prepared: None) -> str:
    """Return the scene."""
    return scene


def make_caller(work: Work, gates: Mapping[str, Any]) -> None:
    """Ask nobody."""


async def close_caller(caller: None) -> None:
    """Close nothing."""


def read_index(scene: str, method: Any, folder: str) -> FoundIndex:
    """Find nothing and miss nothing."""
    return FoundIndex({}, Unstored(cast(Any, None), []), ())


def adopt(context: str, method: Any, index: Any) -> None:
    """Adopt nothing."""


def keep_rows(context: str, method: Any, unstored: Any) -> int:
    """Keep nothing."""
    return 0


def index_views(context: str, method: Any, unstored: Any, part: int, parts: int) -> Any:
    """Render nothing."""
    from workers.index_steps import IndexPart

    return IndexPart.of({})


def join_index(scene: str, method: Any, parts: Any) -> None:
    """Join nothing."""


async def find_evidence(question: Question, vocabulary: tuple[str, ...], caller: None, method: Any) -> str:
    """Return the one category."""
    return vocabulary[0]


def propose(context: str, question: Question, evidence: str, method: Any) -> Any:
    """Return bytes that stand for pictures, after CPU_S of work."""
    until = time.thread_time() + CPU_S
    while time.thread_time() < until:
        pass
    return np.zeros(PICTURE_BYTES, np.uint8) if PICTURE_BYTES else None


async def decide(question: Question, proposal: Any, caller: None, method: Any) -> str:
    """Return a text, after a wait that stands for the models'."""
    if MODEL_S:
        seed = np.frombuffer(question.question_id.encode()[-8:].rjust(8), np.uint64)
        await asyncio.sleep(np.random.default_rng(seed).exponential(MODEL_S))
    return "an answer"


def conclude(
    context: str, question: Question, evidence: str, proposal: Any, decision: str, method: Any
) -> dict[str, tuple[Any, ...]]:
    """Return the rows of a short answer: one answer, three arms, one timing."""
    about = (question.question_id, question.scene, question.task, question.category, "null")
    arms = tuple(
        ArmRow(*about, arm, "answered", "", decision, ("f/0/left",), (0,), 1, 5, "", None, None, None, None)
        for arm in ARMS
    )
    asked = (question.question, question.answer)
    answer = AnswerRow(*about, *asked, (evidence,), 0, 0, 0, "answered", "", decision, "final", 1, "null")
    return {
        "answers": (answer,),
        "arms": arms,
        "timings": (TimingRow(question.question_id, question.scene, "render", 0.0, 0),),
    }


def thumbnails(proposal: Any, rows: Any) -> dict[str, Any]:
    """Return no pictures."""
    return {}


def tables(rows: dict[str, tuple[Any, ...]]) -> Tables:
    """Return the rows."""
    return rows


def failed_rows(question: Question, error: Exception, method: Any = None) -> dict[str, tuple[Any, ...]]:
    """Let a failure end the benchmark."""
    raise error


STEPS = Steps(
    load=load,
    vocabulary=vocabulary,
    prepare=prepare,
    open_context=open_context,
    make_caller=make_caller,
    close_caller=close_caller,
    read_index=read_index,
    adopt_rows=adopt,
    keep_rows=keep_rows,
    index_views=index_views,
    join_index=join_index,
    adopt_index=adopt,
    find_evidence=find_evidence,
    propose=propose,
    decide=decide,
    conclude=conclude,
    thumbnails=thumbnails,
    tables=tables,
    failed_rows=failed_rows,
)
