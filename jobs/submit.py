"""Starting a run and going on with one: `submit` plans and freezes, `resume` needs nothing but the run folder."""

from __future__ import annotations

import dataclasses
import hashlib
import uuid
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jobs.config import JobConfig, checked_job
from jobs.dataset import scene_sha256
from jobs.drive import Driven, drive
from jobs.events import EventLog
from jobs.lock import RunLock
from jobs.plan import basis_of, plan_units
from jobs.progress import Progress, Silent
from jobs.results import write_results
from jobs.signals import Stopping
from jobs.versions import package_versions, source_commit
from pipeline.models.gate import BudgetError
from schemas import storage
from schemas.errors import InputError, StopError
from schemas.manifest import committed_units
from schemas.plan import PLAN_FILE, encode_plan
from schemas.run_folder import RunFolder
from workers.method_steps import METHOD_STEPS
from workers.steps import Steps

FORMAT = 1
"""Version of run.json's layout."""


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
    units = plan_units(config, subject)
    folder = RunFolder(config.output)
    if folder.exists():
        planned = [unit.id for unit in folder.units()]
        if planned != [unit.id for unit in units]:
            raise InputError(
                config.output,
                expected="an empty folder or a run of this very job",
                found=f"a run of {len(planned)} other units: name another output, or remove it",
            )
        return resume(
            config.output,
            steps=steps,
            progress=progress,
            workers=config.workers.model_dump(mode="json"),
            budget=config.budget.model_dump(mode="json"),
            cache=config.cache,
        )
    with RunLock(folder.root):
        plan = encode_plan(units)
        storage.write_bytes_atomic(folder.uri(PLAN_FILE), plan)
        folder.write_run(_run_content(config, plan, len(units)))
        return _work(folder, config, steps, progress or Silent())


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
    found = folder.read_run()
    changes = {"workers": workers or {}, "budget": budget or {}}
    config = _stored_config(folder, found, changes, cache)
    _refuse_changes(folder, config, found)
    with RunLock(folder.root):
        return _work(folder, config, steps, progress or Silent())


def _work(folder: RunFolder, config: JobConfig, steps: Steps, progress: Progress) -> RunResult:
    events = EventLog(folder.root)
    try:
        with Stopping(lambda: progress.say("stopping: waiting for the questions in flight")) as stopping:
            driven = drive(folder, config, steps, events, progress, stopping)
    except BudgetError as error:
        raise StopError(f"{error}: splatreasoner resume {folder.root}") from None
    else:
        if driven.complete:
            write_results(folder.root)
    finally:
        progress.end()
        events.close()
    return RunResult(folder.root, driven)


def _run_content(config: JobConfig, plan: bytes, units: int) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "id": uuid.uuid4().hex,
        "name": config.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "config": config.model_dump(mode="json"),
        "basis": dataclasses.asdict(basis_of(config)),
        "versions": package_versions(),
        "commit": source_commit(),
        "plan": {"sha256": hashlib.sha256(plan).hexdigest(), "units": units},
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
    plan = storage.read_bytes(folder.uri(PLAN_FILE))
    planned, digest = found["plan"].get("sha256"), hashlib.sha256(plan).hexdigest()
    if digest != planned:
        raise InputError(folder.uri(PLAN_FILE), field="sha256", expected=f"{planned}, as run.json says", found=digest)
    now = dataclasses.asdict(basis_of(config))
    for field, value in now.items():
        if value != found["basis"].get(field):
            raise InputError(
                folder.root,
                field=field,
                expected="what the run was planned with",
                found=_difference(found["basis"].get(field), value),
            )
    done, scenes = set(committed_units(folder.root)), dict[str, str]()
    for unit in folder.units():
        if unit.id not in done:
            scenes[unit.scene_uri] = unit.scene_sha256
    for uri, sha256 in scenes.items():
        if scene_sha256(uri) != sha256:
            raise InputError(uri, expected="the scene as the run was planned with", found="files that have changed")


def _difference(before: Any, now: Any) -> str:
    """Say in few words what differs between two pieces of plain data."""
    if isinstance(before, dict) and isinstance(now, dict):
        changed = [key for key in sorted({*before, *now}) if before.get(key) != now.get(key)]
        return "another value of " + ", ".join(
            f"{key} ({_difference(before.get(key), now.get(key))})" for key in changed[:3]
        )
    return f"{before!r} then, {now!r} now"
