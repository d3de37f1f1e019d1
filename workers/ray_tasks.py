"""What runs inside Ray worker processes: the CPU steps as tasks, the model steps as methods of an async actor.

Plain functions and a plain class; `ray_backend.py` makes them remote.
"""

from __future__ import annotations

from typing import Any

from schemas.questions import Question
from workers.contexts import Recent
from workers.steps import Steps, Tables, Work
from workers.thumbnails import save_thumbnails

_contexts: Recent[Any] = Recent()
"""Scene contexts of this worker process."""


def load(steps: Steps, uri: str) -> tuple[Any, Any]:
    """Return the scene and the vocabulary that evidence needs of it; both stay in the object store."""
    scene = steps.load(uri)
    return scene, steps.vocabulary(scene)


def propose(work: Work, steps: Steps, uri: str, scene: Any, question: Question, evidence: Any) -> Any:
    """Return a question's candidate views."""
    context = _contexts.get(uri, lambda: steps.open_context(scene))
    return steps.propose(context, question, evidence, work.method)


def conclude(
    work: Work, steps: Steps, uri: str, scene: Any, question: Question, evidence: Any, proposal: Any, decision: Any
) -> Tables:
    """Return a question's records, after saving the thumbnails of its views."""
    context = _contexts.get(uri, lambda: steps.open_context(scene))
    rows = steps.conclude(context, question, evidence, proposal, decision, work.method)
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
