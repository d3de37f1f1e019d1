"""What can befall a run, for tests to do to it: drivers in processes of their own, and ways to hurt them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from jobs.runs.results import RESULTS
from schemas.manifest import committed_units
from tests.conftest import ROOT

WAIT_S = 120.0
"""Longest wait for anything a test expects."""

HEAD, NODE = "gcs_server", "raylet"
"""Ray's processes that hold the cluster's state and a node's workers."""


def start_driver(
    verb: str, argument: object, module: str = "tests.jobs.run_fake", **environment: str
) -> subprocess.Popen[bytes]:
    """Start `submit JOB.json` or `resume RUN` with the fake steps; `environment` is added to this process's."""
    command = [sys.executable, "-m", module, verb, str(argument)]
    told = {**os.environ, **environment}
    return subprocess.Popen(command, cwd=ROOT, env=told, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


@contextmanager
def driver(
    verb: str, argument: object, module: str = "tests.jobs.run_fake", **environment: str
) -> Iterator[subprocess.Popen[bytes]]:
    """A driver that is gone after the block, whatever happened to it."""
    process = start_driver(verb, argument, module, **environment)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stderr is not None
        process.stderr.close()


def job_file(job: BaseModel, folder: Path) -> Path:
    """Write a job, of questions or of captures, where a driver reads it."""
    path = folder / f"{Path(job.model_dump()['output']).name}.job.json"
    path.write_text(job.model_dump_json())
    return path


def wait_until(condition: Callable[[], Any], process: subprocess.Popen[bytes], what: str) -> Any:
    """Wait until something is so and return it; the test fails when the driver ends first or it takes too long."""
    deadline = time.monotonic() + WAIT_S
    while not (found := condition()):
        if process.poll() is not None or time.monotonic() > deadline:
            process.kill()
            _, errors = process.communicate()
            pytest.fail(f"{what} did not come about: {errors.decode()}")
        time.sleep(0.01)
    return found


def wait_for_commits(run: str, count: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until a run has so many committed units."""
    wait_until(lambda: len(committed_units(run)) >= count, process, f"{count} commits")


def ended(process: subprocess.Popen[bytes], timeout_s: float = WAIT_S) -> tuple[int, str]:
    """Wait for a driver's end and return its exit code and what it said."""
    _, errors = process.communicate(timeout=timeout_s)
    return process.returncode, errors.decode()


def result_bytes(run: str) -> dict[str, bytes]:
    """Return a run's final tables as they lie on disk."""
    return {path.name: path.read_bytes() for path in sorted(Path(run, RESULTS).iterdir())}


def processes(ancestor: int, name: str) -> list[int]:
    """Return the processes below one whose command, or Ray title, has a name in its first word: `HEAD`, "Models"."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            title, pid = (path / "cmdline").read_bytes().split(b"\0")[0].split(b" ")[0].decode(), int(path.name)
            if name in title.rsplit("/", 1)[-1] and ancestor in _ancestors(pid):
                found.append(pid)
        except (FileNotFoundError, ProcessLookupError):
            continue
    return sorted(found)


def kill_process(driver_pid: int, name: str, number: signal.Signals = signal.SIGKILL) -> int:
    """Send a signal to the first process below a driver that has a name; return its id."""
    pids = processes(driver_pid, name)
    assert pids, f"no process {name} below {driver_pid}"
    os.kill(pids[0], number)
    return pids[0]


@contextmanager
def paused(pid: int) -> Iterator[None]:
    """A process sleeps for the block and knows nothing of it."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """A folder that holds only so much; skips where this process may not mount one."""
    folder.mkdir(parents=True, exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)]
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def grow_disk(folder: Path, kilobytes: int) -> None:
    """Make room on a small disk."""
    subprocess.run(["mount", "-o", f"remount,size={kilobytes}k", str(folder)], check=True)


def _ancestors(pid: int) -> set[int]:
    found = set[int]()
    while pid > 1:
        pid = int((Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[1])
        found.add(pid)
    return found
