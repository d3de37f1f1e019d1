"""A build run: captures to scenes with the plan, commits, resume and signals that questions have (`submit.py`)."""

from __future__ import annotations

import dataclasses
import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from jobs.builds.build_job import BuildJob, BuildWorkers, checked_build_job
from jobs.builds.build_plan import build_basis, inputs_sha256, plan_captures
from jobs.runs.difference import differences, told
from jobs.runs.drive import Opened, drive_units
from jobs.runs.events import EventLog
from jobs.runs.lock import RunLock
from jobs.runs.progress import Progress, Silent
from jobs.runs.results import write_results
from jobs.runs.signals import Stopping
from jobs.runs.submit import FORMAT, RunResult, disk_errors, planned_as_written, refused
from jobs.runs.versions import package_versions, source_commit
from schemas import storage
from schemas.build_plan import BUILD_PLAN, PlannedCapture
from schemas.errors import InputError, StopError
from schemas.manifest import committed_units
from schemas.plan import PLAN_FILE, write_plan
from schemas.run_folder import BUILD_RUN, RunFolder, is_build_run
from workers.build_steps import Build, BuildWork, CaptureProgress, build_scene, read_progress
from workers.dispatch import Limits

WORKING = "working"
"""Folder, in the run, of checkpoints and progress unless the job names another."""

LINE_S = 15.0
"""Seconds between two lines about the same stage of a capture."""

SHOWN = 4
"""Captures at work at once whose stages are told line by line; of more, `status` tells."""


def submit_build(
    job: BuildJob, *, subject: object = "job", build: Build = build_scene, progress: Progress | None = None
) -> RunResult:
    """Plan a build job and run it; a run folder that holds the very same plan is resumed instead.

    Args:
        job: The job.
        subject: What messages call it, such as its file.
        build: Builds one capture; tests put fakes here.
        progress: Who is told how it goes; None for nobody.

    Raises:
        InputError: The job or a capture is wrong, or another run lies in the output folder. Nothing has run by then.
        StopError: Another driver is at work, or no further capture can succeed.
    """
    progress = progress or Silent()
    planned, folder = plan_captures(job, subject, progress.say), RunFolder(job.output)
    if folder.exists():
        _refuse_other_job(folder, job, planned)
        workers = job.workers.model_dump(mode="json")
        return resume_build(job.output, build=build, progress=progress, workers=workers)
    with disk_errors(folder.root), RunLock(folder.root, progress.say) as lock:
        if folder.exists():
            raise StopError(f"{folder.root}: another driver planned this run at the same moment; try again")
        plan = write_plan(folder.uri(PLAN_FILE), planned, BUILD_PLAN)
        folder.write_run(
            {
                "format": FORMAT,
                "kind": BUILD_RUN,
                "id": uuid.uuid4().hex,
                "name": job.name,
                "created": datetime.now(UTC).isoformat(timespec="seconds"),
                "config": job.model_dump(mode="json"),
                "basis": dataclasses.asdict(build_basis(job)),
                "versions": package_versions(),
                "commit": source_commit(),
                "plan": {"sha256": plan.sha256, "units": plan.units},
            }
        )
        return _work(folder, job, build, progress, lock)


def resume_build(
    run: str | Path,
    *,
    build: Build = build_scene,
    progress: Progress | None = None,
    workers: dict[str, Any] | None = None,
) -> RunResult:
    """Build what a run still lacks, from its folder alone; a capture that was cut off goes on from its checkpoint.

    Args:
        run: Run folder.
        build: Builds one capture; tests put fakes here.
        progress: Who is told how it goes; None for nobody.
        workers: Fields of `workers` to change.

    Raises:
        InputError: There is no such run, or a capture, the settings or the code have changed since it was planned.
        StopError: Another driver is at work, or no further capture can succeed.
    """
    folder = RunFolder(str(run))
    found, subject = folder.read_run(), folder.uri("run.json")
    if not is_build_run(found):
        raise InputError(folder.root, expected="a run that builds scenes", found="one that answers questions")
    stored = dict(found.get("config") or {})
    # The folder may have been moved since: it is where it is.
    stored["output"] = folder.root
    stored["workers"] = {**(stored.get("workers") or {}), **(workers or {})}
    job = checked_build_job(stored, subject)
    _refuse_changes(folder, job, found)
    progress = progress or Silent()
    with disk_errors(folder.root), RunLock(folder.root, progress.say) as lock:
        return _work(folder, job, build, progress, lock)


def _work(folder: RunFolder, job: BuildJob, build: Build, progress: Progress, lock: RunLock) -> RunResult:
    events, working = EventLog(folder.root), working_folder(folder, job)
    threads, together = _widths(job.workers, len(tuple(folder.captures())))
    stop = working / f"stop-{lock.epoch}"
    taken = storage.local_path(lock.next_claim)
    stops = (str(stop), *(() if taken is None else (str(taken),)))
    work = BuildWork(job.build, job.questions or "", str(working), stops, threads)

    def clear(unit: PlannedCapture) -> None:
        shutil.rmtree(work.folder(unit.id), ignore_errors=True)

    try:
        with Stopping(lambda: progress.say("stopping: each capture keeps what it has")) as stopping:
            opened = partial(_opened, work, build, job, together, progress)
            driven = drive_units(
                folder, folder.captures(), opened, job.workers, events, progress, stopping, lock, clear
            )
        if driven.complete:
            write_results(folder.root)
            shutil.rmtree(working, ignore_errors=True)
    finally:
        stop.unlink(missing_ok=True)
        progress.end()
        events.close()
    return RunResult(folder.root, driven)


def _widths(workers: BuildWorkers, captures: int) -> tuple[int, int]:
    """Return the threads of a capture, and the captures built at once on this machine; 0 for one in this process."""
    slots = workers.cpus or len(os.sched_getaffinity(0))
    alone = workers.in_process or (workers.in_process is None and captures == 1 and not workers.address)
    if alone:
        return workers.threads or slots, 0
    threads = workers.threads or max(1, slots // max(1, captures))
    return threads, max(1, slots // threads)


@contextmanager
def _opened(
    work: BuildWork, build: Build, job: BuildJob, together: int, progress: Progress, note: Callable[..., None]
) -> Iterator[Opened[PlannedCapture]]:
    """Give where captures are built."""
    workers, working = job.workers, Path(work.working)
    # How far an earlier session came is no news.
    before = {one.scene: (one.stage, time.monotonic()) for one in read_progress(working)}
    watch = _Watch(working, Path(work.stops[0]), progress, before)
    if not together:
        from workers.build_here import BuildHere

        here = BuildHere(work, build)
        try:
            yield Opened(here, _limits(workers, 1), watch.look)
        finally:
            here.close()
        return
    from workers.ray_session import ray_session

    with ray_session(cpus=workers.cpus or len(os.sched_getaffinity(0)), address=workers.address) as cluster:
        from workers.build_on_ray import BuildOnRay

        def look(stop: bool) -> bool:
            cluster.head.check()
            return watch.look(stop)

        spread = BuildOnRay(work, build, gpus=int(job.build.train.device == "cuda"))
        yield Opened(spread, _limits(workers, max(1, cluster.slots // work.threads)), look)


def _limits(workers: BuildWorkers, together: int) -> Limits:
    timeout_s = float("inf") if workers.timeout_s is None else workers.timeout_s
    return Limits(together, timeout_s, workers.retries, workers.oom_tries, batch=1, slots=together)


@dataclass(slots=True)
class _Watch:
    """Passes on the wish to stop, and tells how far the captures at work are."""

    working: Path
    stop: Path
    progress: Progress
    told: dict[str, tuple[str, float]]
    """Stage of each capture that was told last, and when."""

    def look(self, stop: bool) -> bool:
        """Tell, and pass on."""
        if stop and not self.stop.exists():
            with suppress(OSError):
                self.stop.touch()
        found, now = read_progress(self.working), time.monotonic()
        for one in found if len(found) <= SHOWN else ():
            stage, when = self.told.get(one.scene, ("", 0.0))
            if one.stage != stage or now - when >= LINE_S:
                self.told[one.scene] = one.stage, now
                self.progress.say(str(one))
        return stop


def working_folder(folder: RunFolder, job: BuildJob) -> Path:
    """Return the run's own folder of checkpoints and progress, also where several runs name the same `working`."""
    return Path(folder.uri(WORKING)) if job.working is None else Path(job.working, folder.identity())


def captures_at_work(folder: RunFolder) -> tuple[CaptureProgress, ...]:
    """Return how far the captures of a build run are that have begun and are not committed."""
    job = checked_build_job({**folder.read_run()["config"], "output": folder.root}, folder.uri("run.json"))
    return read_progress(working_folder(folder, job))


def _refuse_changes(folder: RunFolder, job: BuildJob, found: dict[str, Any]) -> None:
    """Refuse to mix scenes of different settings or code in one run, or to build from captures that have changed."""
    planned_as_written(folder, found)
    changes = told(differences(found.get("basis"), dataclasses.asdict(build_basis(job))))
    if changes:
        raise refused(folder, "the settings and code the run was planned with", changes, "build ...", "")
    done = set(committed_units(folder.root))
    for unit in folder.captures():
        if unit.id not in done and inputs_sha256(job, unit.capture, unit.scene) != unit.capture_sha256:
            expected = "the capture as it was planned, and the labels or weights that name what is in it"
            raise InputError(unit.capture, expected=expected, found="files that have changed")


def _refuse_other_job(folder: RunFolder, job: BuildJob, planned: tuple[PlannedCapture, ...]) -> None:
    """Refuse to plan a job into the folder of another one."""
    found = folder.read_run()
    if not is_build_run(found):
        raise InputError(folder.root, expected="an empty folder or a build run", found="a run that answers questions")
    before, now = ({one.scene: one.capture_sha256 for one in side} for side in (folder.captures(), planned))
    changes = told(
        chain(
            differences(found.get("basis"), dataclasses.asdict(build_basis(job))), differences(before, now, "captures")
        )
    )
    if changes:
        raise refused(folder, "an empty folder or a run of this very job", changes, "build ...", "")
