"""Runs on Ray whose processes are killed, by a stranger or for the memory they take."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from jobs.runs.submit import resume, submit
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.jobs.faults import (
    NODE,
    WAIT_S,
    driver,
    ended,
    job_file,
    kill_process,
    processes,
    wait_for_commits,
    wait_until,
)
from tests.workers.fake_steps import EATEN, STEPS

pytestmark = pytest.mark.slow

TEXTS = ["slow a", "slow no evidence", "slow b", "slow cc"] * 6
VICTIMS = {1: "ray::propose", 4: "ray::Models", 8: "ray::propose"}
"""Which worker is killed after so many commits, by its title."""
EATEN_BYTES, SPARE_BYTES = 5 << 30, 3 << 30
"""What the hungry question takes, and what Ray may take before it kills: room for all that else goes on here."""


@pytest.mark.chaos("worker kill -9")
def test_workers_killed_again_and_again_cost_tries_and_no_row(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, measured: Measured
) -> None:
    make_scene("a", TEXTS)
    make_scene("b", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS).run
    job = make_job("hurt", workers={"in_process": False})
    with driver("submit", job_file(job, tmp_path)) as process:
        for count, victim in VICTIMS.items():
            wait_for_commits(job.output, count, process)
            wait_until(lambda victim=victim: processes(process.pid, victim), process, victim)
            kill_process(process.pid, victim)
            measured.struck()
        code, said = ended(process)
        measured.ended(code)
    assert code == 0, said
    assert "Traceback" not in said
    measured.compare(job.output, whole)
    measured.note = f"{len(VICTIMS)} workers killed"


@pytest.mark.chaos("driver's raylet killed")
def test_driver_whose_own_raylet_is_killed_ends_and_can_be_resumed(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, measured: Measured
) -> None:
    make_scene("a", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS).run
    job = make_job("hurt", workers={"in_process": False})
    with driver("submit", job_file(job, tmp_path)) as process:
        wait_for_commits(job.output, 2, process)
        kill_process(process.pid, NODE)
        measured.struck()
        code, said = ended(process)
        measured.ended(code)
    assert code == 1, said
    assert resume(job.output, steps=STEPS, workers={"in_process": True}).driven.complete
    measured.compare(job.output, whole)


@pytest.mark.chaos("repeated OOM")
def test_question_that_runs_out_of_memory_each_time_becomes_a_failed_row_and_takes_no_other_down(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, measured: Measured
) -> None:
    from ray._private import utils

    make_scene("a", ["a", "b", "eats memory", "cc", "d", "no evidence"])
    make_scene("b", ["a", "b", "cc"])
    whole = submit(make_job("whole"), steps=STEPS).run
    used, total = utils.get_used_memory(), utils.get_system_memory()
    if total - used < EATEN_BYTES + SPARE_BYTES:
        pytest.skip(f"{(total - used) >> 30} GB are free, too few to run out of them safely")
    limits = {
        "RAY_memory_usage_threshold": f"{(used + SPARE_BYTES) / total:.3f}",
        "RAY_memory_monitor_refresh_ms": "100",
    }
    job = make_job("hurt", workers={"in_process": False})
    with driver("submit", job_file(job, tmp_path), **{EATEN: str(EATEN_BYTES)}, **limits) as process:
        code, said = ended(process, 2 * WAIT_S)
        measured.ended(code)
    assert code == 0, said
    measured.compare(job.output, whole, failed={"a-2": "OutOfMemoryError"})
