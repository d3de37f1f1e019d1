"""kill -9 at random points of a run that asks models: nothing stored is paid again, the tables and the totals agree."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jobs.config import JobConfig
from jobs.runs.results import RESULTS
from jobs.runs.submit import submit
from tests.conftest import ROOT
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.models.counting_server import CountingServer
from tests.workers.calling_steps import CALLS, STEPS

TEXTS = [f"question {number}" for number in range(30)]
SENT = len(TEXTS) * (CALLS - 1) + 1
CONCURRENCY = 4
WAIT_S = 240.0

Make = Callable[[CountingServer], JobConfig]


@pytest.fixture
def whole(make_scene: Callable[..., Path], make_job: MakeJob) -> dict[str, bytes]:
    """Results of a run that nothing befell."""
    make_scene("a", TEXTS)
    with CountingServer() as server:
        return results(submit(make_job("whole", models=models(server)), steps=STEPS).run)


def models(server: CountingServer) -> dict[str, Any]:
    endpoint = {"kind": "openai", "base_url": server.base_url, "model": "m", "max_tokens": 50}
    return {"endpoints": {"e": {**endpoint, "concurrency": CONCURRENCY}}, "default": "e"}


def results(run: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(Path(run, RESULTS).iterdir())}


def stored(job: JobConfig) -> int:
    return len(list(Path(job.calls_folder()).glob("??/[0-9a-f]*.json")))


@contextmanager
def driver(job: JobConfig, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A driver of the job, killed at the end of the block if it is still there."""
    file = folder / "job.json"
    file.write_text(job.model_dump_json())
    command = [sys.executable, "-m", "tests.jobs.run_calling", str(file)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for(condition: Callable[[], Any], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        if process.poll() is not None or time.monotonic() > deadline:
            process.kill()
            pytest.fail(f"driver ended or waited {WAIT_S:g} s: {process.communicate()[1].decode()}")
        time.sleep(0.001)


def wait_for_end(pids: list[int]) -> None:
    """Wait for actors, which end a moment after their driver and store until then what they are sent."""
    deadline = time.monotonic() + WAIT_S
    while any(map(runs, pids)):
        if time.monotonic() > deadline:
            pytest.fail(f"processes {pids} outlive their driver")
        time.sleep(0.01)


def runs(pid: int) -> bool:
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def finish(process: subprocess.Popen[bytes]) -> None:
    _, errors = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, errors.decode()


def check_totals(job: JobConfig, server: CountingServer) -> None:
    """The journal knows what every stored reply cost, to the token, and how many calls were let through."""
    (path,) = Path(job.calls_folder(), "journals").rglob("*.jsonl")
    lines = [json.loads(line) for line in path.read_text().splitlines() if line]
    done = [line for line in lines if "done" in line]
    assert sum(line["tokens"] for line in done) == sum(server.tokens.values())
    assert len(done) == SENT == len(server.tokens)
    granted = sum("sent" in line for line in lines) - sum("unsent" in line for line in lines)
    assert granted >= server.sent, "what was sent had been let through"


def kill_drivers(make_job: MakeJob, tmp_path: Path, whole: dict[str, bytes], seed: int, **workers: Any) -> None:
    points = np.sort(np.random.default_rng(seed).choice(np.arange(5, SENT - 10), 2, replace=False))
    with CountingServer(delay_s=0.03) as server:
        job = make_job("killed", models=models(server), workers=workers)
        for point in points:
            if server.sent >= point:
                continue
            with driver(job, tmp_path) as process:
                wait_for(lambda point=point: server.sent >= point, process)
                pids = actors(process.pid, "Models")
                process.send_signal(signal.SIGKILL)
                process.wait()
            wait_for_end(pids)
            kept, before = stored(job), server.sent
            assert before - kept <= CONCURRENCY * len(points), "only calls under way were lost"
        with driver(job, tmp_path) as process:
            finish(process)
        assert server.sent - before == SENT - kept, "no stored call was sent again"
        assert results(job.output) == whole
        check_totals(job, server)


@pytest.mark.parametrize("seed", [1])
def test_killed_drivers_pay_for_nothing_twice(
    make_job: MakeJob, tmp_path: Path, whole: dict[str, bytes], seed: int
) -> None:
    kill_drivers(make_job, tmp_path, whole, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 12))
def test_drivers_killed_at_many_points_pay_for_nothing_twice(
    make_job: MakeJob, tmp_path: Path, whole: dict[str, bytes], seed: int
) -> None:
    kill_drivers(make_job, tmp_path, whole, seed, in_process=seed % 2 == 0)


def kill_actors(
    make_job: MakeJob,
    tmp_path: Path,
    whole: dict[str, bytes],
    seed: int,
    victims: tuple[str, ...],
    measured: Measured,
) -> CountingServer:
    points = np.sort(np.random.default_rng(seed).choice(np.arange(5, SENT - 10), len(victims), replace=False))
    with CountingServer(delay_s=0.05) as server:
        job = make_job("killed", models=models(server), workers={"in_process": False, "model_actors": 2})
        with driver(job, tmp_path) as process:
            for point, victim in zip(points, victims, strict=True):
                wait_for(lambda point=point: server.sent >= point, process)
                pids = actors(process.pid, victim)
                assert pids, f"no process {victim}"
                os.kill(pids[0], signal.SIGKILL)
                measured.struck()
            finish(process)
        measured.ended(0)
        measured.compare(job.output, str(tmp_path / "whole"))
        assert results(job.output) == whole
        check_totals(job, server)
        assert server.most_under_way <= CONCURRENCY * (1 + victims.count("Models"))
        return server


def actors(ancestor: int, name: str) -> list[int]:
    """Return the processes of Ray actors of a class below a process."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            title, pid = (path / "cmdline").read_bytes(), int(path.name)
            if title.startswith(f"ray::{name}".encode()) and ancestor in ancestors(pid):
                found.append(pid)
        except (FileNotFoundError, ProcessLookupError):
            continue
    return sorted(found)


def ancestors(pid: int) -> set[int]:
    found = set[int]()
    while pid > 1:
        pid = int((Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[1])
        found.add(pid)
    return found


@pytest.mark.chaos("limiter killed")
def test_a_killed_limiter_and_a_killed_actor_lose_no_answer(
    make_job: MakeJob, tmp_path: Path, whole: dict[str, bytes], measured: Measured
) -> None:
    server = kill_actors(make_job, tmp_path, whole, 1, ("Limiter", "Models"), measured)
    assert server.sent <= SENT + CONCURRENCY, "only calls under way in the killed actor were sent again"
    measured.sent_twice = server.sent - SENT
    measured.note = "a model actor was killed as well, with calls under way"


@pytest.mark.slow
@pytest.mark.chaos("limiter killed")
@pytest.mark.parametrize("seed", range(2, 8))
def test_a_limiter_killed_at_any_point_costs_no_call(
    make_job: MakeJob, tmp_path: Path, whole: dict[str, bytes], seed: int, measured: Measured
) -> None:
    assert kill_actors(make_job, tmp_path, whole, seed, ("Limiter", "Limiter"), measured).sent == SENT
    measured.sent_twice = 0
