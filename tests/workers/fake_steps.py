"""A method that computes nothing but deterministic rows, with the faults a test asks for in the question's text."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from schemas.answers import AnswerRow, ArmRow
from schemas.calls import TimingRow
from schemas.errors import InputError, QuestionError, RetryError, StopError
from schemas.evidence import CandidateRow
from schemas.plan import PlannedUnit
from schemas.questions import Question
from schemas.run_folder import image_name
from workers.index_steps import FoundIndex, IndexPart, Unstored
from workers.steps import Steps, Tables, Work

VIEWS = 10
POSE = tuple(float(i) for i in range(12))


MARKS = "FAKE_STEPS_MARKS"
"""Environment variable with the folder where faults leave a mark, so that they happen once, whoever retries."""

EATEN = "FAKE_STEPS_EATEN"
"""Environment variable with the bytes that a question takes which eats memory; it takes none without."""

SLOW_S = "FAKE_STEPS_SLOW_S"
"""Environment variable with the seconds that a slow question takes; 0.1 without."""


def once(question: Question) -> bool:
    """True the first time for a question, whatever process asks."""
    try:
        Path(os.environ[MARKS], question.question_id.replace("/", "_")).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def load(uri: str) -> dict[str, Any]:
    if "broken" in uri:
        raise InputError(f"{uri}/gaussians.ply", field="vertex", expected="100 rows", found="3")
    return {"uri": uri, "means": np.arange(30.0, dtype=np.float32).reshape(10, 3)}


def vocabulary(scene: dict[str, Any]) -> tuple[str, ...]:
    return ("chair", "table")


def prepare(scene: dict[str, Any]) -> np.ndarray:
    return scene["means"] + 1


def open_context(scene: dict[str, Any], prepared: np.ndarray | None) -> dict[str, Any]:
    assert prepared is None or not prepared.flags.writeable, "processes share it"
    return {"total": float(scene["means"].sum()), "writeable": scene["means"].flags.writeable, "index": set()}


def read_index(scene: dict[str, Any], method: Any, folder: str) -> FoundIndex:
    """An empty file named by the view stands for a row; one that is not empty is damaged."""
    place, rows, damaged = Path(folder, Path(scene["uri"]).name), {}, []
    for path in sorted(place.glob("*")):
        if path.stat().st_size:
            damaged.append(f"{path}: expected nothing")
            path.unlink()
        else:
            rows[int(path.name)] = np.zeros(0, np.int32)
    missing = [view for view in range(VIEWS) if view not in rows]
    return FoundIndex(rows, Unstored(cast(Any, place), missing), tuple(damaged))


def adopt_rows(context: dict[str, Any], method: Any, rows: Mapping[int, Any]) -> None:
    context["index"] |= set(rows)


def keep_rows(context: dict[str, Any], method: Any, unstored: Unstored) -> int:
    kept = [view for view in unstored.views if view in context["index"]]
    _store(cast(Any, unstored.store), kept)
    unstored.views = [view for view in unstored.views if view not in kept]
    return len(kept)


def index_views(context: dict[str, Any], method: Any, unstored: Unstored, part: int, parts: int) -> IndexPart:
    views = unstored.views[part::parts]
    _store(cast(Any, unstored.store), views)
    return IndexPart.of({view: np.zeros(0, np.int32) for view in views})


def _store(place: Path, views: Sequence[int]) -> None:
    place.mkdir(parents=True, exist_ok=True)
    for view in views:
        (place / str(view)).touch(exist_ok=False)  # nothing is stored twice


def join_index(scene: dict[str, Any], method: Any, parts: Sequence[IndexPart]) -> list[int]:
    return sorted(view for part in parts for view in part.rows())


def adopt_index(context: dict[str, Any], method: Any, joined: list[int]) -> None:
    context["index"] |= set(joined)


def make_caller(work: Work, gates: Mapping[str, Any]) -> str:
    return work.calls


async def close_caller(caller: str) -> None:
    """Nothing is open."""


async def find_evidence(question: Question, vocabulary: tuple[str, ...], caller: str, method: Any) -> str:
    await asyncio.sleep(0)
    if "no evidence" in question.question:
        raise QuestionError("nothing in this scene is named")
    if "stop" in question.question:
        raise StopError("the key was refused")
    if "flaky" in question.question and once(question):
        raise RetryError("the server was busy")
    if "always busy" in question.question:
        raise RetryError("the server was busy")
    return vocabulary[len(question.question) % 2]


def eat() -> None:
    """Take memory and keep it for a while, so that whoever watches sees it."""
    if wanted := int(os.environ.get(EATEN, "0")):
        taken = [np.ones(1 << 24, np.uint8) for _ in range(wanted >> 24)]
        time.sleep(20)
        del taken


def propose(context: dict[str, Any], question: Question, evidence: str, method: Any) -> dict[str, Any]:
    if "slow" in question.question:
        time.sleep(float(os.environ.get(SLOW_S, "0.1")))
    if "kill the worker" in question.question and once(question):
        os._exit(9)
    if "always kills" in question.question:
        os._exit(9)
    if "eats memory" in question.question:
        eat()
    if "bug" in question.question:
        raise ZeroDivisionError("division by zero")
    context["index"].add(len(question.question) % VIEWS)  # a runner with one process renders what a question needs
    if "hangs" in question.question and once(question):
        time.sleep(60)
    return {**context, "image": np.full((300, 400, 3), 7, np.uint8)}


async def decide(question: Question, proposal: dict[str, Any], caller: str, method: Any) -> str:
    await asyncio.sleep(0)
    state = ""
    if "writeable" in question.question and not proposal["writeable"]:
        state = " read-only"
    if "indexed" in question.question:
        state = f" {len(proposal['index'])} views"
    return f"{proposal['total']:g}{state} {question.question_id}"


def conclude(
    context: Any, question: Question, evidence: str, proposal: dict[str, Any], decision: str, method: Any
) -> dict[str, tuple[Any, ...]]:
    return {
        "answers": (answer(question, evidence=(evidence,), answer=decision),),
        "arms": tuple(arm(question, name, answer=decision) for name in ("initial", "final", "verified")),
        "candidates": (candidate(question),),
        "timings": (TimingRow(question.question_id, question.scene, "render", 0.01, 1),),
    }


def thumbnails(proposal: dict[str, Any], rows: dict[str, tuple[Any, ...]]) -> Mapping[str, Any]:
    return {image_name(row.scene, row.candidate, row.world_to_camera): proposal["image"] for row in rows["candidates"]}


def tables(rows: dict[str, tuple[Any, ...]]) -> Tables:
    return rows


def failed_rows(question: Question, error: Exception, method: Any = None) -> dict[str, tuple[Any, ...]]:
    return {"answers": (answer(question, status="failed", reason=f"{type(error).__name__}: {error}"),)}


STEPS = Steps(
    load=load,
    vocabulary=vocabulary,
    prepare=prepare,
    open_context=open_context,
    read_index=read_index,
    adopt_rows=adopt_rows,
    keep_rows=keep_rows,
    index_views=index_views,
    join_index=join_index,
    adopt_index=adopt_index,
    make_caller=make_caller,
    close_caller=close_caller,
    find_evidence=find_evidence,
    propose=propose,
    decide=decide,
    conclude=conclude,
    thumbnails=thumbnails,
    tables=tables,
    failed_rows=failed_rows,
)


def answer(question: Question, **changes: Any) -> AnswerRow:
    values: dict[str, Any] = {
        "question_id": question.question_id,
        "scene": question.scene,
        "task": question.task,
        "category": question.category,
        "method": "fake",
        "question": question.question,
        "reference": question.answer,
        "evidence": (),
        "activated": 0,
        "clusters": 0,
        "clusters_found": 0,
        "status": "answered",
        "reason": "",
        "answer": "",
        "arm": "",
        "frames": 0,
        "model": "fake",
    }
    return AnswerRow(**{**values, **changes})


def arm(question: Question, name: str, **changes: Any) -> ArmRow:
    values: dict[str, Any] = {
        "question_id": question.question_id,
        "scene": question.scene,
        "task": question.task,
        "category": question.category,
        "method": "fake",
        "arm": name,
        "status": "answered",
        "reason": "",
        "answer": "",
        "views": ("f/0/left",),
        "chosen": (0,),
        "frames": 1,
        "mark": 5,
        "mark_reason": "",
        "predicted": None,
        "targets": None,
        "iou": None,
        "region_gaussians": None,
    }
    return ArmRow(**{**values, **changes})


def candidate(question: Question) -> CandidateRow:
    return CandidateRow(
        question_id=question.question_id,
        scene=question.scene,
        cluster=0,
        candidate="f/0/left",
        move="left",
        world_to_camera=POSE,
        requested_m=0.3,
        moved_m=0.3,
        visibility=0.5,
        area=0.1,
        centring=0.2,
        truncation=0.0,
        touches_border=False,
        new_gaussians=3,
        unobserved=None,
        floaters=None,
        source="render",
        answer=None,
        chosen=True,
    )


def unit(index: int, texts: list[str], scene: str = "") -> PlannedUnit:
    name = scene or f"scene{index}"
    questions = tuple(Question(f"{name}-{i}", name, "eqa", text, answer="yes") for i, text in enumerate(texts))
    return PlannedUnit(f"unit{index}", index, name, f"/scenes/{name}", "0" * 64, "fake", questions)
