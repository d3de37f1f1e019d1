"""A whole run on an S3 store: killed and resumed, with the store away for a while, a second driver, and verify."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from jobs.runs.events import read_events
from jobs.runs.results import RESULTS
from jobs.runs.status import run_status
from jobs.runs.submit import resume, submit
from jobs.runs.verify import verify_run
from schemas import object_store, storage
from schemas.manifest import commit_unit, committed_units
from tests.conftest import ROOT
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.schemas.s3_server import Proxy, address, s3
from tests.workers.fake_steps import STEPS, answer

pytest.importorskip("moto", reason="moto[server] is not installed")

TEXTS = ["slow a", "slow no evidence", "slow b", "slow cc"] * 2
WAIT_S = 120.0


@pytest.fixture(scope="module")
def proxy() -> Iterator[Proxy]:
    with s3() as found:
        yield found


@pytest.fixture(autouse=True)
def well_again(proxy: Proxy) -> Iterator[None]:
    yield
    proxy.fault = lambda line: ""


def results(run: str) -> dict[str, bytes]:
    place = storage.join(run, RESULTS)
    return {name: storage.read_bytes(storage.join(place, name)) for name in storage.list_files(place)}


def test_killed_run_resumes_to_the_bytes_of_a_local_one(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, proxy: Proxy
) -> None:
    make_scene("a", TEXTS)
    make_scene("b", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS)
    run = address(proxy.port, "killed")
    local = {"calls": str(tmp_path / "calls"), "visibility": str(tmp_path / "visibility")}
    job = make_job("killed", output=run, **local)
    file = tmp_path / "job.json"
    file.write_text(job.model_dump_json())
    command = [sys.executable, "-m", "tests.jobs.run_fake", "submit", str(file)]
    driver = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    deadline = time.monotonic() + WAIT_S
    while len(committed_units(run)) < 2:
        if driver.poll() is not None or time.monotonic() > deadline:
            driver.kill()
            pytest.fail(driver.communicate()[1].decode())
        time.sleep(0.05)
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    assert 0 < run_status(run).units_done < run_status(run).units == 6
    assert storage.list_files(storage.join(run, RESULTS)) == ()

    assert resume(run, steps=STEPS).driven.complete
    assert results(run) == results(whole.run)
    found = verify_run(run, clean=True)
    assert (found.problems, found.questions) == ([], 16)
    assert verify_run(run).orphans == ()
    assert [event["event"] for event in read_events(run)][-1] == "ended"


@pytest.mark.chaos("S3 away")
def test_run_outlives_a_store_that_is_away_and_a_second_driver_finds_it_taken(
    make_scene: Callable[..., Path],
    make_job: MakeJob,
    tmp_path: Path,
    proxy: Proxy,
    monkeypatch: pytest.MonkeyPatch,
    measured: Measured,
) -> None:
    monkeypatch.setattr(object_store, "WAITS_S", (0.05, 0.1, 0.2, 0.4, 0.8, 1.6))
    make_scene("a", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS)
    run = address(proxy.port, "away")
    local = {"calls": str(tmp_path / "calls"), "visibility": str(tmp_path / "visibility")}
    started, puts = list[float](), list[str]()

    def fault(line: str) -> str:
        """From the first manifest on, the store is away for a second; later every fifth answer is lost."""
        if line.startswith("PUT") and "/manifests/" in line:
            started.append(time.monotonic())
        if started and time.monotonic() - started[0] < 1.0:
            return "reset"
        puts.append(line)
        return "lost" if line.startswith("PUT") and len(puts) % 5 == 0 else ""

    proxy.fault = fault
    assert measured.run(lambda: submit(make_job("away", output=run, **local), steps=STEPS)) is None
    proxy.fault = lambda line: ""
    assert started, "the store was away"
    measured.compare(run, whole.run)
    assert results(run) == results(whole.run)
    assert verify_run(run).problems == []
    unit = committed_units(run)[0]
    late = commit_unit(run, unit, {"answers": [answer(q) for q in _unit(run, unit)]}, epoch=99)
    assert not late.won


def _unit(run: str, name: str) -> tuple[object, ...]:
    from schemas.run_folder import RunFolder

    return next(unit.questions for unit in RunFolder(run).units() if unit.id == name)


def test_stored_replies_on_a_store_are_refused_with_what_to_do(
    make_scene: Callable[..., Path], make_job: MakeJob
) -> None:
    make_scene("a", TEXTS)
    with pytest.raises(ValueError, match="calls: expected a local folder, since the output is not local"):
        make_job("x", output="s3://bucket/run")
