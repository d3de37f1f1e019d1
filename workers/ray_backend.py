"""The backend on Ray: per batch, four steps whose arguments are references, so a waiting step holds no CPU.

once a scene: load -> prepare, read_index -> index_views (a part each slot) -> join_index
once a batch of its questions: evidence (actor) -> propose (CPU) -> decide (actor) -> conclude (CPU)
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ray
from ray import exceptions
from ray.exceptions import GetTimeoutError, RayError, RayTaskError, TaskCancelledError
from ray.experimental import get_local_object_locations
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers import ray_tasks
from workers.contexts import Recent
from workers.dispatch import Ended, OutOfMemoryError, WorkerLostError
from workers.limiter import Limiter, limited_endpoints
from workers.ray_tasks import SceneKey
from workers.steps import Steps, Tables, Work
from workers.together import Failed, Together
from workers.watchdog import bounded

FETCH_S = 20.0
"""Seconds to bring an ended batch's records here; they are small, so longer means their node is gone."""

CLOSE_S = 10.0
"""Seconds the model actors get to say what their last calls cost."""

KILL_S = 5.0
"""Seconds Ray gets to end what is no longer needed; without its head it would wait for ever."""

LISTENING = 10_000
"""Exchanges the limiter holds at once: two for each model actor and endpoint, more than any run has."""

SCENES_HELD = 3
"""Scenes whose object-store reference is kept; in-flight questions keep theirs alive by themselves."""


# Retries are the ledger's (`dispatch.py`): Ray would run a killed task again unseen and uncounted.
_load = ray.remote(num_returns=3, max_retries=0)(ray_tasks.load)
_prepare = ray.remote(num_returns=2, max_retries=0)(ray_tasks.prepare)
_read_index = ray.remote(num_returns=3, max_retries=0)(ray_tasks.read_index)
_index_views = ray.remote(num_returns=2, max_retries=0)(ray_tasks.index_views)
_join_index = ray.remote(num_returns=3, max_retries=0)(ray_tasks.join_index)
_propose = ray.remote(max_retries=0)(ray_tasks.propose)
_conclude = ray.remote(max_retries=0)(ray_tasks.conclude)
_Limiter = ray.remote(num_cpus=0, max_task_retries=0)(Limiter)


class Models(ray_tasks.Models):
    """Finds its limiter by name: an actor whose arguments hold references cannot be started again without them."""

    def __init__(self, work: Work, steps: Steps, limiter: str, place: str) -> None:
        super().__init__(work, steps, ray.get_actor(limiter) if limiter else None, place)


_Models = ray.remote(num_cpus=0, max_task_retries=0)(Models)


@dataclass(slots=True)
class HeldScene:
    """References to what a scene's questions share."""

    key: SceneKey
    """Which scene."""
    scene: Any
    """Its arrays."""
    prepared: Any
    """What every process needs beside them."""
    vocabulary: Any
    """What evidence needs of it."""
    index: Any
    """Its visibility index."""
    unstored: Any
    """What the disk still lacks of it."""
    notes: tuple[Any, ...]
    """How long loading and indexing took and what was amiss; empty once a question's records have them."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """References of questions that travel together."""

    scene: HeldScene
    """What they share with the scene's other questions."""
    steps: tuple[Any, ...]
    """evidence, propose, decide, conclude; the last one is the result."""


class OnRay:
    """Runs questions on the Ray cluster this process is connected to (`ray_session.py`).

    Args:
        work: What the run needs.
        steps: The functions of a question.
        model_actors: Processes that ask models.
        in_flight: Most batches one of them may be asked at once.
        slots: CPU slots; each gets a part of a scene's visibility index to compute.
        note: Told what happened, as a kind and details: "damaged".
    """

    def __init__(
        self,
        work: Work,
        steps: Steps,
        *,
        model_actors: int,
        in_flight: int,
        slots: int,
        note: Callable[..., None] = lambda kind, **details: None,
    ) -> None:
        self._steps, self._slots, self._note, self._method = steps, slots, note, work.method
        self._work_ref, self._steps_ref = ray.put(work), ray.put(steps)
        options = {"max_concurrency": max(2, in_flight), "max_restarts": -1}
        # By value: Ray cannot restart an actor whose arguments have left the object store.
        limiter = f"limiter-{uuid.uuid4().hex}" if limited_endpoints(work) else ""
        self._limiter = _start_limiter(work, limiter) if limiter else None
        self._models = [
            _Models.options(**options).remote(work, steps, limiter, f"models-{number}")
            for number in range(model_actors)
        ]
        self._scenes: Recent[HeldScene] = Recent(SCENES_HELD)
        self._submitted = 0

    def submit(self, unit: PlannedUnit, questions: Sequence[Question]) -> Chain:
        """Start a batch's chain; nothing here waits."""
        work, steps = self._work_ref, self._steps_ref
        held = self._scenes.get(unit.scene_uri, lambda: self._open(unit))
        models = self._models[self._submitted % len(self._models)]
        self._submitted += 1
        evidence = models.find_evidence.remote(questions, held.vocabulary)
        shared = (work, steps, held.key, held.scene, held.prepared)
        proposals = _propose.remote(*shared, questions, evidence, held.index, held.unstored)
        decisions = models.decide.remote(questions, proposals)
        tables = _conclude.remote(*shared, questions, evidence, proposals, decisions)
        return Chain(held, (evidence, proposals, decisions, tables))

    def _open(self, unit: PlannedUnit) -> HeldScene:
        """Start loading and indexing a scene."""
        key = SceneKey(unit.scene_uri, unit.scene)
        work, steps = self._work_ref, self._steps_ref
        scene, vocabulary, loading = _load.remote(steps, key)
        prepared, preparing = _prepare.remote(steps, key, scene)
        stored, unstored, reading = _read_index.remote(work, steps, key, scene)
        rendered = [
            _index_views.remote(work, steps, key, scene, prepared, unstored, part, self._slots)
            for part in range(self._slots)
        ]
        parts, indexing = (tuple(refs) for refs in zip(*rendered, strict=True))
        # Workers read the joined index where it lies; the parts leave the object store with this scope.
        index, left, joining = _join_index.remote(work, steps, key, scene, unstored, stored, *parts)
        return HeldScene(
            key, scene, prepared, vocabulary, index, left, (loading, preparing, reading, *indexing, joining)
        )

    def wait(self, handles: Sequence[Chain], timeout_s: float) -> Sequence[Chain]:
        """Return the chains that have ended."""
        chains = {chain.steps[-1]: chain for chain in handles}
        ended, _ = ray.wait(list(chains), num_returns=1, timeout=timeout_s, fetch_local=False)
        if ended:
            ended, _ = ray.wait(list(chains), num_returns=len(chains), timeout=0, fetch_local=False)
        return [chains[ref] for ref in ended]

    def result(self, handle: Chain) -> Ended:
        """Return what became of a chain's questions, or raise what ended it as our own code raised it."""
        try:
            found: Together = ray.get(handle.steps[-1], timeout=FETCH_S)
            notes = ray.get(list(handle.scene.notes), timeout=FETCH_S)
        except RayTaskError as error:
            raise own_error(error) from None
        except (GetTimeoutError, RayError) as error:
            raise lost_work(error) from None
        results = [value.error if isinstance(value, Failed) else value for value in found.values]
        for place, tables in enumerate(results):
            if notes and not isinstance(tables, Exception):
                # Work done once a scene stands in the records of whichever question ended first.
                handle.scene.notes = ()
                for message in (text for noted in notes for text in noted.damaged):
                    self._note("damaged", scene=handle.scene.key.name, message=message)
                results[place] = {**tables, "timings": (*(n.time for n in notes), *tables.get("timings", ()))}
                break
        return Ended(results, found.seconds, _held_bytes(handle.steps))

    def cancel(self, handle: Chain) -> None:
        """Cancel every step; those that run in a task are killed with their process."""
        evidence, proposals, decisions, tables = handle.steps

        def give_up() -> None:
            for ref in (tables, proposals):
                ray.cancel(ref, force=True)
            for ref in (decisions, evidence):
                ray.cancel(ref)

        bounded(give_up, KILL_S)

    def forget(self, unit: PlannedUnit) -> None:
        """Drop the reference to the unit's scene."""
        self._scenes.drop(unit.scene_uri)

    def failed(self, question: Question, error: Exception) -> Tables:
        """Return the records of a failed question."""
        return self._steps.tables(self._steps.failed_rows(question, error, self._method))

    def close(self) -> None:
        """End the actors; the session ends the rest."""
        ray.wait([actor.close.remote() for actor in self._models], num_returns=len(self._models), timeout=CLOSE_S)
        actors = (*self._models, *filter(None, [self._limiter]))
        bounded(lambda: [ray.kill(actor) for actor in actors], KILL_S)
        self._models, self._limiter = [], None


def store_bytes() -> int:
    """Return the size of the cluster's object store."""
    return int(ray.cluster_resources()["object_store_memory"])


def _start_limiter(work: Work, name: str) -> Any:
    """Start the run's limiter on this node, where its journals lie; when it dies it is started again from them."""
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=True)
    options = {"name": name, "max_restarts": -1, "max_concurrency": LISTENING, "scheduling_strategy": here}
    return _Limiter.options(**options).remote(work)


def own_error(error: RayTaskError) -> Exception:
    """Return what was raised in the worker; lost or cancelled work of an earlier step counts as a lost worker."""
    cause = error.cause
    while isinstance(cause, RayTaskError):
        cause = cause.cause
    if isinstance(cause, RayError | TaskCancelledError):
        return lost_work(cause)
    if not isinstance(cause, Exception):
        return WorkerLostError(_first_line(error))
    # The traceback stays behind in the worker; its text is what a person needs.
    cause.add_note(str(error))
    return cause


def lost_work(error: Exception) -> WorkerLostError:
    """Return the error of work whose process, node or object is gone."""
    kind = OutOfMemoryError if isinstance(error, exceptions.OutOfMemoryError) else WorkerLostError
    return kind(f"{type(error).__name__}: {_first_line(error)}")


def _held_bytes(refs: Sequence[Any]) -> int:
    """Return the bytes of objects that this process owns, wherever they lie."""
    found = get_local_object_locations(list(refs))
    return sum(place.get("object_size") or 0 for place in found.values())


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
