"""The backend on Ray: per question, four steps whose arguments are references, so a waiting step holds no CPU.

load (once a scene) -> evidence (actor) -> propose (CPU) -> decide (actor) -> conclude (CPU)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ray
from ray.exceptions import GetTimeoutError, RayError, RayTaskError, TaskCancelledError

from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers import ray_tasks
from workers.contexts import Recent
from workers.dispatch import WorkerLostError
from workers.ray_tasks import SceneKey
from workers.steps import Steps, Tables, Work

FETCH_S = 60.0
"""Seconds to bring an ended question's records here; they are small, so longer means their node is gone."""

SCENES_HELD = 3
"""Scenes whose object-store reference is kept; in-flight questions keep theirs alive by themselves."""


# Retries are the ledger's (`dispatch.py`): Ray would run a killed task again unseen and uncounted.
_load = ray.remote(num_returns=3, max_retries=0)(ray_tasks.load)
_index_views = ray.remote(num_returns=2, max_retries=0)(ray_tasks.index_views)
_propose = ray.remote(max_retries=0)(ray_tasks.propose)
_conclude = ray.remote(max_retries=0)(ray_tasks.conclude)
_Models = ray.remote(num_cpus=0, max_task_retries=0)(ray_tasks.Models)


@dataclass(slots=True)
class HeldScene:
    """References to what a scene's questions share."""

    key: SceneKey
    """Which scene."""
    scene: Any
    """Its arrays."""
    vocabulary: Any
    """What evidence needs of it."""
    index: tuple[Any, ...]
    """Parts of its visibility index."""
    times: tuple[Any, ...]
    """How long loading and indexing took; empty once a question's records have them."""


@dataclass(frozen=True, slots=True)
class Chain:
    """One question's references."""

    scene: HeldScene
    """What it shares with the scene's other questions."""
    steps: tuple[Any, ...]
    """evidence, propose, decide, conclude; the last one is the result."""

    def __hash__(self) -> int:
        return hash(self.steps[-1])


class OnRay:
    """Runs questions on the Ray cluster this process is connected to (`ray_session.py`).

    Args:
        work: What the run needs.
        steps: The functions of a question.
        model_actors: Processes that ask models.
        in_flight: Most questions one of them may be asked at once.
        slots: CPU slots; each gets a part of a scene's visibility index to compute.
    """

    def __init__(self, work: Work, steps: Steps, *, model_actors: int, in_flight: int, slots: int) -> None:
        self._steps, self._slots = steps, slots
        self._work_ref, self._steps_ref = ray.put(work), ray.put(steps)
        options = {"max_concurrency": max(2, in_flight), "max_restarts": -1}
        # By value: Ray cannot restart an actor whose arguments have left the object store.
        self._models = [_Models.options(**options).remote(work, steps) for _ in range(model_actors)]
        self._scenes: Recent[HeldScene] = Recent(SCENES_HELD)
        self._submitted = 0

    def submit(self, unit: PlannedUnit, question: Question) -> Chain:
        """Start a question's chain; nothing here waits."""
        work, steps = self._work_ref, self._steps_ref
        held = self._scenes.get(unit.scene_uri, lambda: self._open(unit))
        models = self._models[self._submitted % len(self._models)]
        self._submitted += 1
        evidence = models.find_evidence.remote(question, held.vocabulary)
        proposal = _propose.remote(work, steps, held.key, held.scene, question, evidence, *held.index)
        decision = models.decide.remote(question, proposal)
        tables = _conclude.remote(work, steps, held.key, held.scene, question, evidence, proposal, decision)
        return Chain(held, (evidence, proposal, decision, tables))

    def _open(self, unit: PlannedUnit) -> HeldScene:
        """Start loading and indexing a scene."""
        key = SceneKey(unit.scene_uri, unit.scene)
        scene, vocabulary, loading = _load.remote(self._steps_ref, key)
        parts = [
            _index_views.remote(self._work_ref, self._steps_ref, key, scene, part, self._slots)
            for part in range(self._slots)
        ]
        index, indexing = (tuple(refs) for refs in zip(*parts, strict=True))
        return HeldScene(key, scene, vocabulary, index, (loading, *indexing))

    def wait(self, handles: Sequence[Chain], timeout_s: float) -> Sequence[Chain]:
        """Return the chains that have ended."""
        last = [chain.steps[-1] for chain in handles]
        ended, _ = ray.wait(last, num_returns=1, timeout=timeout_s, fetch_local=False)
        if ended:
            ended, _ = ray.wait(last, num_returns=len(last), timeout=0, fetch_local=False)
        known = set(ended)
        return [chain for chain in handles if chain.steps[-1] in known]

    def result(self, handle: Chain) -> Tables:
        """Return a chain's records, or raise what ended it as our own code raised it."""
        try:
            tables: Tables = ray.get(handle.steps[-1], timeout=FETCH_S)
            times = ray.get(list(handle.scene.times), timeout=FETCH_S)
        except RayTaskError as error:
            raise _own_error(error) from None
        except (GetTimeoutError, RayError) as error:
            raise WorkerLostError(f"{type(error).__name__}: {_first_line(error)}") from None
        if not times:
            return tables
        # Work done once a scene stands in the records of whichever question ended first.
        handle.scene.times = ()
        return {**tables, "timings": (*times, *tables.get("timings", ()))}

    def cancel(self, handle: Chain) -> None:
        """Cancel every step; those that run in a task are killed with their process."""
        evidence, proposal, decision, tables = handle.steps
        for ref in (tables, proposal):
            ray.cancel(ref, force=True)
        for ref in (decision, evidence):
            ray.cancel(ref)

    def forget(self, unit: PlannedUnit) -> None:
        """Drop the reference to the unit's scene."""
        self._scenes.drop(unit.scene_uri)

    def failed(self, question: Question, error: Exception) -> Tables:
        """Return the records of a failed question."""
        return self._steps.tables(self._steps.failed_rows(question, error))

    def close(self) -> None:
        """End the model actors; the session ends the rest."""
        for actor in self._models:
            ray.kill(actor)
        self._models = []


def _own_error(error: RayTaskError) -> Exception:
    """Return what was raised in the worker; lost or cancelled work of an earlier step counts as a lost worker."""
    cause = error.cause
    while isinstance(cause, RayTaskError):
        cause = cause.cause
    if isinstance(cause, RayError | TaskCancelledError):
        return WorkerLostError(f"{type(cause).__name__}: {_first_line(cause)}")
    if not isinstance(cause, Exception):
        return WorkerLostError(_first_line(error))
    # The traceback stays behind in the worker; its text is what a person needs.
    cause.add_note(str(error))
    return cause


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
