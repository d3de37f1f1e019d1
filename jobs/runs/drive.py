"""The driver: pending units to a runner, and outcomes on to be committed (`commits.py`).

`drive` answers questions; `drive_units` is the same for any units, such as captures to be built (`build_captures.py`).
"""

from __future__ import annotations

import os
import socket
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel

from jobs.config import JobConfig, WorkersConfig
from jobs.runs.commits import Commits
from jobs.runs.events import EventLog
from jobs.runs.lock import RunLock
from jobs.runs.progress import Progress
from jobs.runs.signals import Stopping
from jobs.runs.spend import CallTotals
from schemas.manifest import committed_units, damaged_units, discard_unit
from schemas.plan import PlannedUnit
from schemas.plan_columns import unit_sizes
from schemas.run_folder import RunFolder
from workers.dispatch import Backend, Limits, Unit, dispatch
from workers.pace import MOST_TOGETHER
from workers.steps import Steps, Work

JOURNALS = "journals"
"""Folder, beside stored replies, of what the calls of each run cost."""

BATCHES_PER_CPU = 4
"""Batches in flight a CPU slot: each spends most of its time waiting for a model or another step."""

STORE_SHARE = 4
"""Part of Ray's object store that questions in flight may hold: scenes lie there as well."""


U = TypeVar("U", bound=Unit)


@dataclass(frozen=True, slots=True)
class Opened(Generic[U]):
    """Where units run, for a session."""

    backend: Backend[Any, U]
    """Runs their items."""
    limits: Limits
    """Bounds of dispatch."""
    look: Callable[[bool], bool] = lambda stop: stop
    """Called every tick with whether someone asked to stop; returns that. Raises a StopError once what runs the
    items is gone for good."""


def watching(check: Callable[[], object]) -> Callable[[bool], bool]:
    """Return an `Opened.look` that calls `check` every tick."""

    def look(stop: bool) -> bool:
        check()
        return stop

    return look


@dataclass(frozen=True, slots=True)
class Driven:
    """How a session of work on a run ended."""

    planned: int
    """Questions in the plan."""
    done: int
    """Questions in committed units."""
    failed: int
    """Questions of this session whose rows record an error."""
    stopped: bool
    """Someone asked it to stop."""

    @property
    def complete(self) -> bool:
        """Whether every planned question is committed."""
        return self.done == self.planned


def drive(
    run: RunFolder,
    config: JobConfig,
    steps: Steps,
    events: EventLog,
    progress: Progress,
    stopping: Stopping,
    lock: RunLock,
) -> Driven:
    """Do the units of a run that are not committed.

    Args:
        run: The run.
        config: Its job.
        steps: The method.
        events: Its diary.
        progress: Who is told how it goes.
        stopping: Whether someone asked it to stop.
        lock: The run's lock, held by the caller; looked at before every commit.

    Raises:
        StopError: No further question can succeed, or another driver has taken the run; what was complete is committed.
    """
    work = Work(
        config.method,
        config.models,
        config.calls_folder(),
        config.visibility_folder(),
        run.root if config.images else "",
        config.cache,
        config.budget,
        journals=str(Path(config.calls_folder(), JOURNALS, run.identity())),
        session=uuid.uuid4().hex,
    )
    opened = partial(_backend, work, steps, config.workers)
    return drive_units(run, run.units(), opened, config.workers, events, progress, stopping, lock)


def drive_units(
    run: RunFolder,
    units: Iterable[U],
    opened: Callable[[Callable[..., None]], AbstractContextManager[Opened[U]]],
    workers: BaseModel,
    events: EventLog,
    progress: Progress,
    stopping: Stopping,
    lock: RunLock,
    committed_one: Callable[[U], object] = lambda unit: None,
) -> Driven:
    """Do the units that are not committed, whatever their items are.

    Args:
        run: The run.
        units: Its planned units.
        opened: Gives, for a block, where they run; takes who is told what happens there.
        workers: Settings of that, for the diary.
        events: The run's diary.
        progress: Who is told how it goes.
        stopping: Whether someone asked it to stop.
        lock: The run's lock, held by the caller; looked at before every commit.
        committed_one: Called with each unit that was committed.

    Raises:
        StopError: As `drive`.
    """
    done, sizes = _sound_units(run, events, progress, lock), unit_sizes(run.root)
    planned = sum(sizes.values())
    before = sum(size for unit, size in sizes.items() if unit in done)
    driver = {"pid": os.getpid(), "host": socket.gethostname(), "session": lock.epoch}
    events.note("started", questions=planned, done=before, workers=workers.model_dump(mode="json"), **driver)
    progress.begin(planned, before)
    committed, failed = before, 0
    if before < planned:

        def note(kind: str, **details: Any) -> None:
            events.note(kind, **details)
            if kind == "damaged":
                progress.say(f"rendered again, since a part is damaged: {details['message']}")

        pending = (unit for unit in units if unit.id not in done)
        commits = Commits(run, sizes, lock, events)
        with opened(note) as there:

            def should_stop() -> bool:
                if lock.lost:
                    lock.check()
                return there.look(stopping())

            stopping.catch()
            for outcome in dispatch(pending, there.backend, there.limits, should_stop=should_stop, note=note):
                failed += bool(outcome.error)
                progress.spent(CallTotals.of(outcome.tables.get("calls", ())))
                progress.advance(outcome.error)
                if count := commits.add(outcome):
                    committed += count
                    committed_one(outcome.unit)
    stopped = stopping() and committed < planned
    events.note("stopped" if stopped else "ended", done=committed, failed=failed)
    return Driven(planned, committed, failed, stopped)


def _sound_units(run: RunFolder, events: EventLog, progress: Progress, lock: RunLock) -> set[str]:
    """Return the committed units, after taking back those whose parts are not as their manifests say."""
    for found in damaged_units(run.root):
        lock.check()
        discard_unit(run.root, found.unit, epoch=lock.epoch, reason=found.message, generation=found.generation)
        events.note("damaged", unit=found.unit, message=found.message)
        progress.say(f"done again, since a part is damaged: {found.message}")
    return set(committed_units(run.root))


@contextmanager
def _backend(
    work: Work, steps: Steps, config: WorkersConfig, note: Callable[..., None]
) -> Iterator[Opened[PlannedUnit]]:
    """Give the backend that a config asks for."""
    cpus = config.cpus or len(os.sched_getaffinity(0))
    if config.in_process:
        from workers.in_process import InProcess

        local = InProcess(work, steps, note)
        try:
            yield Opened(local, _limits(config, 1))
        finally:
            local.close()
        return
    from workers.ray_session import ray_session

    with ray_session(cpus=cpus, address=config.address) as cluster:
        from workers.ray_backend import OnRay, store_bytes

        limits = _limits(config, cluster.slots, store_bytes() // STORE_SHARE)
        batches = limits.batches or limits.in_flight
        spread = OnRay(work, steps, model_actors=config.model_actors, in_flight=batches, slots=cluster.slots, note=note)
        try:
            yield Opened(spread, limits, watching(cluster.head.check))
        finally:
            spread.close()


def _limits(config: WorkersConfig, slots: int, memory: int | None = None) -> Limits:
    batches = BATCHES_PER_CPU * slots
    asked = config.questions_in_flight
    return Limits(
        asked or batches * MOST_TOGETHER,
        config.timeout_s,
        config.retries,
        config.oom_tries,
        batch=config.batch,
        batches=None if asked else batches,
        slots=slots,
        memory=memory if config.memory_mb is None else config.memory_mb * 1_000_000,
    )
