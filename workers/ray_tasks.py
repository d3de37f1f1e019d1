"""What runs inside Ray worker processes: the CPU steps as tasks, the model steps as methods of an async actor.

Plain functions and a plain class; `ray_backend.py` makes them remote. A question's step takes and gives a batch
(`together.py`): what goes wrong with one question stays with it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from schemas.calls import TimingRow
from schemas.errors import RetryError
from schemas.questions import Question
from workers.contexts import Recent
from workers.dispatch import WorkerLostError
from workers.index_steps import IndexPart, Unstored
from workers.limiter import gates, remote_authorities
from workers.steps import Steps, Tables, Work
from workers.thumbnails import save_thumbnails
from workers.together import Together, each, each_async


@dataclass(frozen=True, slots=True)
class SceneKey:
    """Which scene a step is about."""

    uri: str
    """Path or URI."""
    name: str
    """Name, as rows carry it."""


@dataclass(frozen=True, slots=True)
class Noted:
    """What is told of work done once a scene."""

    time: TimingRow
    """How long it took."""
    damaged: tuple[str, ...] = ()
    """What was wrong with stored parts that are made again."""


@dataclass(slots=True)
class _Opened:
    """A scene's context in this process."""

    context: Any
    unstored: Any = None
    """Rows that neither the disk nor this process has stored; None until the index is adopted."""


_contexts: Recent[_Opened] = Recent()
"""Scene contexts of this worker process."""


def load(steps: Steps, key: SceneKey) -> tuple[Any, Any, Noted]:
    """Return the scene, the vocabulary that evidence needs of it, and how long it took.

    Raises:
        InputError: The scene is wrong.
        WorkerLostError: Its store failed to answer; the scene is to be loaded anew.
    """
    start = time.perf_counter()
    with _reopened(key):
        scene = steps.load(key.uri)
    return scene, steps.vocabulary(scene), _noted(key, "load", start, 1)


def prepare(steps: Steps, key: SceneKey, scene: Any) -> tuple[Any, Noted]:
    """Return what every process needs of a scene beside its arrays."""
    start = time.perf_counter()
    return steps.prepare(scene), _noted(key, "prepare", start, 1)


def read_index(work: Work, steps: Steps, key: SceneKey, scene: Any) -> tuple[Any, Unstored, Noted]:
    """Return the rows of a scene's visibility index that lie on disk, and what is missing there.

    Raises:
        InputError: The folder may not be read.
        WorkerLostError: Its store failed to answer; the scene is to be opened anew.
    """
    start = time.perf_counter()
    with _reopened(key):
        found = steps.read_index(scene, work.method, work.visibility)
    return IndexPart.of(found.rows), found.unstored, _noted(key, "index_read", start, len(found.rows), found.damaged)


def index_views(
    work: Work, steps: Steps, key: SceneKey, scene: Any, prepared: Any, unstored: Any, part: int, parts: int
) -> tuple[Any, Noted]:
    """Return a part of the rows that the disk lacked, after rendering and storing them.

    Raises:
        InputError: The folder may not be written.
        WorkerLostError: Its store failed to answer; the scene is to be opened anew.
    """
    opened = _contexts.get(key.uri, lambda: _Opened(steps.open_context(scene, prepared)))
    start = time.perf_counter()
    with _reopened(key):
        found = steps.index_views(opened.context, work.method, unstored, part, parts)
    return found, _noted(key, "index", start, len(found.views))


def join_index(
    work: Work, steps: Steps, key: SceneKey, scene: Any, unstored: Unstored, *parts: IndexPart
) -> tuple[Any, Unstored, Noted]:
    """Return the visibility index of a scene in the form that every worker reads, and what the disk still lacks."""
    start = time.perf_counter()
    joined = steps.join_index(scene, work.method, parts)
    there = {view for part in parts for view in part.views.tolist()}
    left = Unstored(unstored.store, [view for view in unstored.views if view not in there])
    return joined, left, _noted(key, "index_join", start, len(there))


def propose(
    work: Work,
    steps: Steps,
    key: SceneKey,
    scene: Any,
    prepared: Any,
    questions: Sequence[Question],
    evidence: Together,
    index: Any,
    unstored: Any,
) -> Together:
    """Return questions' candidate views, after storing the rows of the index that they had rendered."""
    opened = _contexts.get(key.uri, lambda: _Opened(steps.open_context(scene, prepared)))
    if opened.unstored is None:
        steps.adopt_index(opened.context, work.method, index)
        opened.unstored = unstored

    def one(question: Question, found: Any) -> Any:
        proposal = steps.propose(opened.context, question, found, work.method)
        with _reopened(key):
            steps.keep_rows(opened.context, work.method, opened.unstored)
        return proposal

    return each(one, questions, evidence)


def conclude(
    work: Work,
    steps: Steps,
    key: SceneKey,
    scene: Any,
    prepared: Any,
    questions: Sequence[Question],
    evidence: Together,
    proposals: Together,
    decisions: Together,
) -> Together:
    """Return questions' records, after saving the thumbnails of their views."""
    opened = _contexts.get(key.uri, lambda: _Opened(steps.open_context(scene, prepared)))

    def one(question: Question, found: Any, proposal: Any, decision: Any) -> Tables:
        rows = steps.conclude(opened.context, question, found, proposal, decision, work.method)
        if work.images:
            save_thumbnails(work.images, steps.thumbnails(proposal, rows))
        return steps.tables(rows)

    return each(one, questions, evidence, proposals, decisions)


class Models:
    """Asks the models; async, so that one actor waits on many calls at once and holds no CPU slot.

    Args:
        work: What the run needs.
        steps: The functions of a question.
        limiter: Handle of the run's `Limiter`; None where nothing is asked over a network.
        place: This actor's name, kept when it is started again.
    """

    def __init__(self, work: Work, steps: Steps, limiter: Any = None, place: str = "") -> None:
        self._work, self._steps = work, steps
        authorities = {} if limiter is None else remote_authorities(work, limiter)
        self._caller = steps.make_caller(work, gates(authorities, place))

    async def find_evidence(self, questions: Sequence[Question], vocabulary: Any) -> Together:
        """Return questions' evidence categories."""
        return await each_async(
            lambda question: self._steps.find_evidence(question, vocabulary, self._caller, self._work.method), questions
        )

    async def decide(self, questions: Sequence[Question], proposals: Together) -> Together:
        """Return what the models decided on questions' candidate views."""
        return await each_async(
            lambda question, proposal: self._steps.decide(question, proposal, self._caller, self._work.method),
            questions,
            proposals,
        )

    async def close(self) -> None:
        """Ask no more."""
        await self._steps.close_caller(self._caller)


@contextmanager
def _reopened(key: SceneKey) -> Iterator[None]:
    """Turn a failure that may pass into a lost scene: the next try opens it anew, and not its question only."""
    try:
        yield
    except RetryError as error:
        raise WorkerLostError(f"opening {key.uri}: {error}") from error


def _noted(key: SceneKey, stage: str, start: float, count: int, damaged: tuple[str, ...] = ()) -> Noted:
    return Noted(TimingRow("", key.name, stage, time.perf_counter() - start, count), damaged)
