"""Killing a driver half way and resuming gives the very bytes of an undisturbed run."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from jobs.runs import lock
from jobs.runs.lock import driver_alive
from jobs.runs.results import RESULTS
from jobs.runs.status import run_status
from jobs.runs.submit import resume, submit
from schemas.errors import StopError
from schemas.manifest import committed_units, damaged_units
from schemas.run_folder import read_table
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.jobs.faults import (
    HEAD,
    driver,
    ended,
    grow_disk,
    job_file,
    kill_process,
    paused,
    result_bytes,
    small_disk,
    wait_for_commits,
)
from tests.workers.fake_steps import SLOW_S, STEPS

TEXTS = ["slow a", "slow no evidence", "slow b", "slow cc", "slow bug"] * 3


def committed(run: str) -> dict[Path, bytes]:
    """What a reader of the run starts from."""
    return {path: path.read_bytes() for path in Path(run, "manifests").iterdir()}


@pytest.mark.chaos("driver kill -9")
@pytest.mark.parametrize(
    # On Ray the default run ends a driver by SIGTERM, below, and kills its actors (test_kills).
    "in_process",
    [True, pytest.param(False, marks=pytest.mark.slow)],
    ids=["in process", "on Ray"],
)
def test_killed_driver_resumes_to_the_same_bytes(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, in_process: bool, measured: Measured
) -> None:
    make_scene("a", TEXTS)
    make_scene("b", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS)
    job = make_job("killed", workers={"in_process": in_process})
    with driver("submit", job_file(job, tmp_path)) as process:
        wait_for_commits(job.output, 3, process)
        process.send_signal(signal.SIGKILL)
    before = run_status(job.output)
    assert 0 < before.units_done < before.units == 10
    assert not driver_alive(job.output)
    assert not Path(job.output, RESULTS).exists()

    again = resume(job.output, steps=STEPS, workers={"in_process": True})
    assert again.driven.complete
    measured.compare(job.output, whole.run)
    assert result_bytes(job.output) == result_bytes(whole.run)
    # What was committed before the kill was not done again.
    assert again.driven.failed < run_status(job.output).statuses["failed"] == 12


@pytest.mark.chaos("SIGTERM")
@pytest.mark.parametrize(
    ("number", "in_process"),
    [(signal.SIGINT, True), (signal.SIGTERM, False)],
    ids=["SIGINT in process", "SIGTERM on Ray, which has a handler of its own"],
)
def test_signal_commits_what_is_done_and_exits_130(
    make_scene: Callable[..., Path],
    make_job: MakeJob,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: signal.Signals,
    in_process: bool,
    measured: Measured,
) -> None:
    make_scene("a", TEXTS * 4)
    monkeypatch.setenv(SLOW_S, "0")
    whole = submit(make_job("whole"), steps=STEPS).run
    job = make_job(workers={"in_process": in_process})
    with driver("submit", job_file(job, tmp_path), **{SLOW_S: "0.1"}) as process:
        wait_for_commits(job.output, 2, process)
        process.send_signal(number)
        measured.struck()
        code, said = ended(process)
        measured.ended(code)
    assert code == 130, said
    assert "stopping" in said
    assert not run_status(job.output).complete
    assert resume(job.output, steps=STEPS, workers={"in_process": True}).driven.complete
    measured.compare(job.output, whole)


def test_second_driver_is_refused_while_the_first_works(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path
) -> None:
    make_scene("a", TEXTS)
    job = make_job()
    with driver("submit", job_file(job, tmp_path)) as process:
        wait_for_commits(job.output, 1, process)
        assert run_status(job.output).running
        with pytest.raises(StopError, match=f"another driver is at work on this run .process {process.pid} on "):
            resume(job.output, steps=STEPS)


@pytest.mark.chaos("two drivers")
def test_driver_that_slept_while_another_finished_its_run_is_fenced_out(
    make_scene: Callable[..., Path],
    make_job: MakeJob,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    measured: Measured,
) -> None:
    make_scene("a", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS)
    job = make_job("shared")
    monkeypatch.setattr(lock, "ABANDONED_S", 0.5)
    with driver("submit", job_file(job, tmp_path)) as process:
        wait_for_commits(job.output, 2, process)
        with paused(process.pid):
            before = len(committed_units(job.output))
            assert before < 5
            assert resume(job.output, steps=STEPS).driven.complete
            found = committed(job.output)
        measured.struck()
        code, said = ended(process)
        measured.ended(code)
    assert code == 1, said
    assert "took this run over" in said
    assert "Traceback" not in said
    measured.compare(job.output, whole.run)
    assert result_bytes(job.output) == result_bytes(whole.run)
    assert read_table(job.output, "answers")["question_id"].is_unique
    assert committed(job.output) == found, "the stale driver wrote nothing that counts"


@pytest.mark.slow
@pytest.mark.chaos("GCS loss")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stuck"])
def test_driver_whose_ray_loses_its_head_ends_in_time_and_can_be_resumed(
    make_scene: Callable[..., Path],
    make_job: MakeJob,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: signal.Signals,
    measured: Measured,
) -> None:
    make_scene("a", TEXTS * 10)
    monkeypatch.setenv(SLOW_S, "0")
    whole = submit(make_job("whole"), steps=STEPS).run
    job = make_job("headless", workers={"in_process": False})
    # What has begun goes on without the head: there must be more to do than the silence lasts.
    with driver("submit", job_file(job, tmp_path), **{SLOW_S: "1"}) as process:
        wait_for_commits(job.output, 2, process)
        head = kill_process(process.pid, HEAD, number)
        measured.struck()
        code, said = ended(process)
        measured.ended(code)
        with suppress(ProcessLookupError):
            os.kill(head, signal.SIGKILL)
    assert code == 1, said
    assert measured.seconds is not None
    assert measured.seconds < 90
    assert "the head of the local Ray has not answered for" in said
    assert "Traceback" not in said
    assert "Failed to connect" not in said, "Ray's own words"
    assert not run_status(job.output).complete
    assert resume(job.output, steps=STEPS, workers={"in_process": True}).driven.complete
    measured.compare(job.output, whole)


@pytest.mark.chaos("full disk")
@pytest.mark.parametrize(
    "in_process", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["in process", "on Ray"]
)
def test_full_disk_stops_the_run_and_costs_nothing_that_was_committed(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, in_process: bool, measured: Measured
) -> None:
    make_scene("a", [text.removeprefix("slow ") for text in TEXTS * 8])
    whole = submit(make_job("whole"), steps=STEPS)
    with small_disk(tmp_path / "disk", 700) as disk:
        job = make_job("disk/run", workers={"in_process": in_process})
        with driver("submit", job_file(job, tmp_path)) as process:
            code, said = ended(process)
            measured.ended(code)
        assert code == 1, said
        assert "No space left on device" in said
        assert "resume" in said
        assert "Traceback" not in said
        assert 0 < len(committed_units(job.output)) < 40
        assert not list(damaged_units(job.output))
        grow_disk(disk, 100_000)
        assert resume(job.output, steps=STEPS, workers={"in_process": True}).driven.complete
        measured.compare(job.output, whole.run)
        assert result_bytes(job.output) == result_bytes(whole.run)
