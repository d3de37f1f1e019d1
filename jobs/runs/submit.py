"""Starting a run and going on with one: `submit` plans and freezes, `resume` needs nothing but the run folder."""

from __future__ import annotations

import dataclasses
import hashlib
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

from jobs.config import JobConfig, checked_job
from jobs.dataset import scene_sha256
from jobs.runs.difference import differences, told, unit_differences
from jobs.runs.drive import Driven, drive
from jobs.runs.events import EventLog
from jobs.runs.lock import RunLock
from jobs.runs.plan import basis_of, plan_units
from jobs.runs.progress import Progress, Silent
from jobs.runs.results import write_results
from jobs.runs.signals import Stopping
from jobs.runs.versions import package_versions, source_commit
from pipeline.models.gate import BudgetError
from schemas import storage
from schemas.errors import InputError, StopError
from schemas.manifest import committed_units
from schemas.plan import PLAN_FILE, PlannedUnit, WrittenPlan, write_plan
from schemas.run_folder import RunFolder
from workers.method_steps import METHOD_STEPS
from workers.steps import Steps

FORMAT = 1
"""Version of run.json's layout."""

DATA = ("scenes", "questions", "tasks", "limit", "other_scenes")
"""Fields of a job that say what is asked."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """Where a run lies and how its latest session ended."""

    run: str
    """Run folder."""
    driven: Driven
    """How the session ended."""


def submit(
    config: JobConfig,
    *,
    subject: object = "job",
    steps: Steps = METHOD_STEPS,
    progress: Progress | None = None,
) -> RunResult:
    """Plan a job and run it; a run folder that holds the very same plan is resumed instead.

    Args:
        config: The job.
        subject: What messages call it, such as its file.
        steps: The method; tests put fakes here.
        progress: Who is told how it goes; None for nobody.

    Raises:
        InputError: The job, a scene or a question file is wrong, or another run lies in the output folder. Nothing
            has run by then.
        StopError: Another driver is at work, or no further question can succeed.
    """
    progress = progress or Silent()
    units = plan_units(config, subject, progress.say)
    folder = RunFolder(config.output)
    if folder.exists():
        _refuse_other_job(folder, config, units)
        return resume(
            config.output,
            steps=steps,
            progress=progress,
            workers=config.workers.model_dump(mode="json"),
            budget=config.budget.model_dump(mode="json"),
            cache=config.cache,
        )
    with disk_errors(folder.root), RunLock(folder.root, progress.say) as lock:
        if folder.exists():
            raise StopError(f"{folder.root}: another driver planned this run at the same moment; try again")
        plan = write_plan(folder.uri(PLAN_FILE), units)
        folder.write_run(_run_content(config, plan))
        return _work(folder, config, steps, progress, lock)


def in_another_folder(config: JobConfig, output: str) -> JobConfig:
    """Return a job whose run lies elsewhere, its stored replies and visibility index where they were.

    So a changed job pays for no call that the first one made already.
    """
    kept = {"calls": config.calls_folder(), "visibility": config.visibility_folder()}
    place = storage.local_path(output)
    there = output if place is None else str(place.expanduser().absolute())
    return checked_job({**config.model_dump(mode="json"), **kept, "output": there}, "--output")


def resume(
    run: str | Path,
    *,
    steps: Steps = METHOD_STEPS,
    progress: Progress | None = None,
    workers: dict[str, Any] | None = None,
    budget: dict[str, Any] | None = None,
    cache: str | None = None,
) -> RunResult:
    """Do what a run still lacks, from its folder alone.

    Args:
        run: Run folder.
        steps: The method; tests put fakes here.
        progress: Who is told how it goes; None for nobody.
        workers: Fields of `workers` to change, such as {"cpus": 8}; they change no answer.
        budget: Fields of `budget` to change, such as {"usd": 20}.
        cache: What to do with stored replies: on, off or replay; None for what the job says.

    Raises:
        InputError: There is no such run, or a scene, a prompt, a model or a stage's code has changed since it was
            planned.
        StopError: Another driver is at work, or no further question can succeed.
    """
    folder = RunFolder(str(run))
    folder.refuse_builds()
    found = folder.read_run()
    changes = {"workers": workers or {}, "budget": budget or {}}
    config = _stored_config(folder, found, changes, cache)
    _refuse_changes(folder, config, found)
    progress = progress or Silent()
    with disk_errors(folder.root), RunLock(folder.root, progress.say) as lock:
        return _work(folder, config, steps, progress, lock)


def _work(folder: RunFolder, config: JobConfig, steps: Steps, progress: Progress, lock: RunLock) -> RunResult:
    events = EventLog(folder.root)
    try:
        with Stopping(lambda: progress.say("stopping: waiting for the questions in flight")) as stopping:
            driven = drive(folder, config, steps, events, progress, stopping, lock)
    except BudgetError as error:
        raise StopError(f"{error}: splatreasoner resume {folder.root}") from None
    else:
        if driven.complete:
            write_results(folder.root)
    finally:
        progress.end()
        events.close()
    return RunResult(folder.root, driven)


@contextmanager
def disk_errors(run: str) -> Iterator[None]:
    """Say what a disk refused, whoever wrote: no question is at fault, and what is committed stays."""
    try:
        yield
    except OSError as error:
        # pyarrow puts all it knows into one text.
        raise StopError(f"{error.filename or run}: {error.strerror or error}: mend that, then resume") from error


def _run_content(config: JobConfig, plan: WrittenPlan) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "id": uuid.uuid4().hex,
        "name": config.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "config": config.model_dump(mode="json"),
        "basis": dataclasses.asdict(basis_of(config)),
        "versions": package_versions(),
        "commit": source_commit(),
        "plan": {"sha256": plan.sha256, "units": plan.units},
    }


def _stored_config(
    folder: RunFolder, found: dict[str, Any], changes: dict[str, dict[str, Any]], cache: str | None
) -> JobConfig:
    subject = folder.uri("run.json")
    for field in ("config", "basis", "plan"):
        if not isinstance(found.get(field), dict):
            raise InputError(subject, field=field, expected="an object", found=type(found.get(field)).__name__)
    if found.get("format") != FORMAT:
        raise InputError(subject, field="format", expected=FORMAT, found=found.get("format"))  # type: ignore[arg-type]
    stored = dict(found["config"])
    # The folder may have been moved since: it is where it is.
    stored["output"] = folder.root
    for section, fields in changes.items():
        stored[section] = {**stored.get(section, {}), **fields}
    stored["cache"] = cache or stored.get("cache", "on")
    return checked_job(stored, subject)


def _refuse_changes(folder: RunFolder, config: JobConfig, found: dict[str, Any]) -> None:
    """Refuse to mix answers of different scenes, prompts, models or code in one run."""
    planned_as_written(folder, found)
    changes = told(differences(found["basis"], _plain_basis(config)))
    if changes:
        raise refused(folder, "the prompts, models and code the run was planned with", changes)
    done, scenes = set(committed_units(folder.root)), dict[str, str]()
    for unit in folder.units():
        if unit.id not in done:
            scenes[unit.scene_uri] = unit.scene_sha256
    for uri, sha256 in scenes.items():
        if scene_sha256(uri) != sha256:
            raise InputError(uri, expected="the scene as the run was planned with", found="files that have changed")


def planned_as_written(folder: RunFolder, found: Mapping[str, Any]) -> None:
    """Refuse a plan that is not the one run.json was written with.

    Raises:
        InputError: It is not.
    """
    with storage.local_copy(folder.uri(PLAN_FILE)) as path, path.open("rb") as plan:
        planned, digest = found["plan"].get("sha256"), hashlib.file_digest(plan, "sha256").hexdigest()
    if digest != planned:
        raise InputError(folder.uri(PLAN_FILE), field="sha256", expected=f"{planned}, as run.json says", found=digest)


def _refuse_other_job(folder: RunFolder, config: JobConfig, units: Iterator[PlannedUnit]) -> None:
    """Refuse to plan a job into the folder of another one."""
    folder.refuse_builds()
    if all(old is not None and new is not None and old.id == new.id for old, new in zip_longest(folder.units(), units)):
        return
    found = folder.read_run()
    changes = told(
        chain(
            differences(_asked(found.get("config") or {}), _asked(config.model_dump(mode="json"))),
            differences(found.get("basis"), _plain_basis(config)),
            unit_differences(folder.units(), plan_units(config)),
        )
    )
    raise refused(folder, "an empty folder or a run of this very job", changes)


def refused(
    folder: RunFolder,
    expected: str,
    changes: list[str],
    again: str = "submit JOB.yaml",
    kept: str = "; stored replies are used again",
) -> InputError:
    """Return the error that names every change, and what can be done."""
    error = InputError(folder.root, expected=expected, found="one that differs in:")
    for change in changes:
        error.add_note(f"  {change}")
    error.add_note(f"either undo that, or run the job as it is now into another folder{kept}:")
    error.add_note(f"  splatreasoner {again} --output ANOTHER_FOLDER")
    return error


def _asked(job: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a job, as plain data, that say what is asked."""
    return {**{field: job.get(field) for field in DATA}, "workers": {"chunk": job.get("workers", {}).get("chunk")}}


def _plain_basis(config: JobConfig) -> dict[str, Any]:
    return dataclasses.asdict(basis_of(config))
