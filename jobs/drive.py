"""The driver: pending units to a runner, outcomes into committed parts. All writing to a run's tables happens here."""

from __future__ import annotations

import os
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jobs.config import JobConfig, WorkersConfig
from jobs.events import EventLog
from jobs.progress import Progress
from jobs.signals import Stopping
from schemas.manifest import commit_unit, committed_units, damage
from schemas.run_folder import RunFolder
from schemas.tables import TABLES
from workers.dispatch import Backend, Limits, Outcome, dispatch
from workers.steps import Steps, Tables, Work

JOURNALS = "journals"
"""Folder, beside stored replies, of what the calls of each run cost."""

QUESTIONS_PER_CPU = 4
"""Questions in flight a CPU slot: each spends most of its time waiting for a model or another step."""


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
) -> Driven:
    """Do the units of a run that are not committed; the caller holds the run's lock.

    Raises:
        StopError: No further question can succeed; what was complete is committed.
    """
    done = _sound_units(run, events, progress)
    planned = before = 0
    for unit in run.units():
        planned += len(unit.questions)
        before += len(unit.questions) if unit.id in done else 0
    events.note("started", questions=planned, done=before, workers=config.workers.model_dump(mode="json"))
    progress.begin(planned, before)
    committed, failed = before, 0
    if before < planned:
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

        def note(kind: str, **details: Any) -> None:
            events.note(kind, **details)
            if kind == "damaged":
                progress.say(f"rendered again, since a part is damaged: {details['message']}")

        pending = (unit for unit in run.units() if unit.id not in done)
        gathering: dict[str, list[Tables | None]] = {}
        with _backend(work, steps, config.workers, note) as (backend, limits):
            stopping.catch()
            for outcome in dispatch(pending, backend, limits, should_stop=stopping, note=note):
                failed += bool(outcome.error)
                progress.advance(outcome.error)
                unit = outcome.unit
                gathered = gathering.setdefault(unit.id, [None] * len(unit.questions))
                gathered[outcome.position] = _checked(outcome)
                if None not in gathered:
                    rows = _merged(gathering.pop(unit.id))
                    commit_unit(run.root, unit.id, rows)
                    committed += len(unit.questions)
                    events.note("committed", unit=unit.id, scene=unit.scene, questions=len(unit.questions))
    stopped = stopping() and committed < planned
    events.note("stopped" if stopped else "ended", done=committed, failed=failed)
    return Driven(planned, committed, failed, stopped)


def _sound_units(run: RunFolder, events: EventLog, progress: Progress) -> set[str]:
    """Return the committed units whose parts are all as their manifests say; the others are done again."""
    sound = set()
    for unit in committed_units(run.root):
        wrong = damage(run.root, unit)
        if wrong:
            events.note("damaged", unit=unit, message=wrong)
            progress.say(f"done again, since a part is damaged: {wrong}")
        else:
            sound.add(unit)
    return sound


def _checked(outcome: Outcome) -> Tables:
    """Return the outcome's tables, sure to hold exactly one answer, to the question that was asked."""
    asked = outcome.unit.questions[outcome.position].question_id
    answers = outcome.tables.get("answers", ())
    assert [row.question_id for row in answers] == [asked], f"question {asked} must have one row in answers"
    return outcome.tables


def _merged(gathered: list[Tables | None]) -> dict[str, list[Any]]:
    """Return a unit's records by table, questions in plan order."""
    merged: dict[str, list[Any]] = {name: [] for name in TABLES}
    for tables in gathered:
        assert tables is not None
        for name, records in tables.items():
            merged[name].extend(records)
    return merged


@contextmanager
def _backend(
    work: Work, steps: Steps, config: WorkersConfig, note: Callable[..., None]
) -> Iterator[tuple[Backend[Any], Limits]]:
    """Give the backend that a config asks for, and its bounds."""
    cpus = config.cpus or len(os.sched_getaffinity(0))
    if config.in_process:
        from workers.in_process import InProcess

        local = InProcess(work, steps, note)
        try:
            yield local, _limits(config, 1)
        finally:
            local.close()
        return
    from workers.ray_session import ray_session

    with ray_session(cpus=cpus, address=config.address) as slots:
        from workers.ray_backend import OnRay

        limits = _limits(config, slots)
        actors = config.model_actors
        spread = OnRay(work, steps, model_actors=actors, in_flight=limits.in_flight, slots=slots, note=note)
        try:
            yield spread, limits
        finally:
            spread.close()


def _limits(config: WorkersConfig, slots: int) -> Limits:
    in_flight = config.questions_in_flight or QUESTIONS_PER_CPU * slots
    return Limits(in_flight, config.timeout_s, config.retries)
