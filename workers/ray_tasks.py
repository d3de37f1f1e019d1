"""What runs inside Ray worker processes: the CPU steps as tasks, the model steps as methods of an async actor.

Plain functions and a plain class; `ray_backend.py` makes them remote.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from schemas.calls import TimingRow
from schemas.errors import RetryError
from schemas.questions import Question
from workers.contexts import Recent
from workers.dispatch import WorkerLostError
from workers.steps import Steps, Tables, Work
from workers.thumbnails import save_thumbnails


@dataclass(frozen=True, slots=True)
class SceneKey:
    """Which scene a step is about."""

    uri: str
    """Path or URI."""
    name: str
    """Name, as rows carry it."""


@dataclass(slots=True)
class _Opened:
    """A scene's context in this process."""

    context: Any
    adopted: bool = field(default=False)


_contexts: Recent[_Opened] = Recent()
"""Scene contexts of this worker process."""


def load(steps: Steps, key: SceneKey) -> tuple[Any, Any, TimingRow]:
    """Return the scene, the vocabulary that evidence needs of it, and how long it took.

    Raises:
        InputError: The scene is wrong.
        WorkerLostError: Its store failed to answer; the scene is to be loaded anew.
    """
    start = time.perf_counter()
    try:
        scene = steps.load(key.uri)
    except RetryError as error:
        raise WorkerLostError(f"loading {key.uri}: {error}") from error
    return scene, steps.vocabulary(scene), _timing(key, "load", start, 1)


def index_views(work: Work, steps: Steps, key: SceneKey, scene: Any, part: int, parts: int) -> tuple[Any, TimingRow]:
    """Return a part of a scene's visibility index, and how long it took."""
    opened = _contexts.get(key.uri, lambda: _Opened(steps.open_context(scene)))
    start = time.perf_counter()
    found, views = steps.index_views(opened.context, work.method, part, parts)
    return found, _timing(key, "index", start, views)


def propose(work: Work, steps: Steps, key: SceneKey, scene: Any, question: Question, evidence: Any, *index: Any) -> Any:
    """Return a question's candidate views."""
    opened = _contexts.get(key.uri, lambda: _Opened(steps.open_context(scene)))
    if not opened.adopted:
        for part in index:
            steps.adopt_index(opened.context, work.method, part)
        opened.adopted = True
    return steps.propose(opened.context, question, evidence, work.method)


def conclude(
    work: Work, steps: Steps, key: SceneKey, scene: Any, question: Question, evidence: Any, proposal: Any, decision: Any
) -> Tables:
    """Return a question's records, after saving the thumbnails of its views."""
    opened = _contexts.get(key.uri, lambda: _Opened(steps.open_context(scene)))
    rows = steps.conclude(opened.context, question, evidence, proposal, decision, work.method)
    if work.images:
        save_thumbnails(work.images, steps.thumbnails(proposal, rows))
    return steps.tables(rows)


class Models:
    """Asks the models; async, so that one actor waits on many calls at once and holds no CPU slot.

    Args:
        work: What the run needs.
        steps: The functions of a question.
    """

    def __init__(self, work: Work, steps: Steps) -> None:
        self._work, self._steps = work, steps
        self._caller = steps.make_caller(work)

    async def find_evidence(self, question: Question, vocabulary: Any) -> Any:
        """Return a question's evidence categories."""
        return await self._steps.find_evidence(question, vocabulary, self._caller, self._work.method)

    async def decide(self, question: Question, proposal: Any) -> Any:
        """Return what the models decided on a question's candidate views."""
        return await self._steps.decide(question, proposal, self._caller, self._work.method)


def _timing(key: SceneKey, stage: str, start: float, count: int) -> TimingRow:
    return TimingRow("", key.name, stage, time.perf_counter() - start, count)
