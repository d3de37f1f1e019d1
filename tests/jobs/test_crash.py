"""Killing a driver half way and resuming gives the very bytes of an undisturbed run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from jobs.lock import LOCK_FILE
from jobs.results import RESULTS
from jobs.status import run_status
from jobs.submit import resume, submit
from schemas.errors import StopError
from schemas.manifest import committed_units
from tests.conftest import ROOT
from tests.jobs.conftest import MakeJob
from tests.workers.fake_steps import STEPS

TEXTS = ["slow a", "slow no evidence", "slow b", "slow cc", "slow bug"] * 3
WAIT_S = 60.0


def result_bytes(run: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(Path(run, RESULTS).iterdir())}


def start_driver(verb: str, argument: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tests.jobs.run_fake", verb, str(argument)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def wait_for_commits(run: str, count: int, driver: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + WAIT_S
    while len(committed_units(run)) < count:
        if driver.poll() is not None or time.monotonic() > deadline:
            _, errors = driver.communicate()
            pytest.fail(f"no {count} commits: {errors.decode()}")
        time.sleep(0.01)


@pytest.mark.parametrize("in_process", [True, False], ids=["in process", "on Ray"])
def test_killed_driver_resumes_to_the_same_bytes(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, in_process: bool
) -> None:
    make_scene("a", TEXTS)
    make_scene("b", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS)
    job = make_job("killed", workers={"in_process": in_process})
    file = tmp_path / "job.json"
    file.write_text(job.model_dump_json())
    driver = start_driver("submit", file)
    wait_for_commits(job.output, 3, driver)
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    before = run_status(job.output)
    assert 0 < before.units_done < before.units == 10
    assert not before.running
    assert not Path(job.output, RESULTS).exists()
    assert (Path(job.output) / LOCK_FILE).exists(), "a killed driver leaves its lock"

    ended = resume(job.output, steps=STEPS, workers={"in_process": True})
    assert ended.driven.complete
    assert result_bytes(job.output) == result_bytes(whole.run)
    assert not (Path(job.output) / LOCK_FILE).exists()
    # What was committed before the kill was not done again.
    assert ended.driven.failed < run_status(job.output).statuses["failed"] == 12


@pytest.mark.parametrize(
    ("number", "in_process"),
    [(signal.SIGINT, True), (signal.SIGTERM, False)],
    ids=["SIGINT in process", "SIGTERM on Ray, which has a handler of its own"],
)
def test_signal_commits_what_is_done_and_exits_130(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, number: signal.Signals, in_process: bool
) -> None:
    make_scene("a", TEXTS * 4)
    job = make_job(workers={"in_process": in_process})
    file = tmp_path / "job.json"
    file.write_text(job.model_dump_json())
    driver = start_driver("submit", file)
    wait_for_commits(job.output, 2, driver)
    driver.send_signal(number)
    _, errors = driver.communicate(timeout=WAIT_S)
    assert driver.returncode == 130, errors.decode()
    assert b"stopping" in errors
    assert not run_status(job.output).complete
    assert resume(job.output, steps=STEPS, workers={"in_process": True}).driven.complete


def test_second_driver_is_refused_while_the_first_works(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path
) -> None:
    make_scene("a", TEXTS)
    job = make_job()
    file = tmp_path / "job.json"
    file.write_text(job.model_dump_json())
    driver = start_driver("submit", file)
    try:
        wait_for_commits(job.output, 1, driver)
        assert run_status(job.output).running
        with pytest.raises(StopError, match=f"another driver is at work on this run .process {driver.pid} on "):
            resume(job.output, steps=STEPS)
    finally:
        os.kill(driver.pid, signal.SIGKILL)
        driver.communicate()
