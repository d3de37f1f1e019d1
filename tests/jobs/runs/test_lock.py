from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from jobs.runs import lock
from jobs.runs.lock import FOLDER, FencedError, RunLock, driver_alive, read_holder
from jobs.runs.submit import resume, submit
from schemas.errors import StopError
from schemas.manifest import committed_units, discard_unit, load_manifest
from tests.jobs.conftest import MakeJob
from tests.jobs.faults import paused
from tests.workers.fake_steps import STEPS

HOUR_S = 3600.0


def write_claim(run: Path, epoch: int = 1, beat: int = 1, **changes: Any) -> None:
    holder = {"epoch": epoch, "owner": "other", "host": "elsewhere", "space": "", "pid": 1, "started": "1"}
    (run / FOLDER).mkdir(exist_ok=True)
    (run / FOLDER / f"{epoch:06d}.json").write_text(json.dumps({**holder, **changes}))
    write_beat(run, epoch, beat)


def write_beat(run: Path, epoch: int, beat: int) -> None:
    aside = run / FOLDER / "aside"
    aside.write_text(json.dumps({"beat": beat, "ended": False}))
    aside.replace(run / FOLDER / f"{epoch:06d}.beat")


def here(**changes: Any) -> dict[str, Any]:
    return {"host": socket.gethostname(), "space": lock._space(), **changes}


@contextmanager
def beating(run: Path, epoch: int, mtime: float) -> Iterator[None]:
    """Another machine's driver raises its counter; its files say they were written at another time of day."""
    over = threading.Event()

    def beat() -> None:
        count = 1
        while not over.wait(0.02):
            count += 1
            write_beat(run, epoch, count)
            os.utime(run / FOLDER / f"{epoch:06d}.beat", (mtime, mtime))

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time runs thirty times as fast."""
    monkeypatch.setattr(lock, "BEAT_S", 0.02)
    monkeypatch.setattr(lock, "LOOK_S", 0.02)
    monkeypatch.setattr(lock, "GLANCE_S", 0.5)
    monkeypatch.setattr(lock, "ABANDONED_S", 0.5)


def test_lock_is_held_in_the_block_and_free_after_it(tmp_path: Path) -> None:
    assert not driver_alive(str(tmp_path))
    with RunLock(str(tmp_path)) as first:
        assert driver_alive(str(tmp_path))
        refused = f"at work on this run .process {os.getpid()} on {socket.gethostname()}.; stop it first"
        with pytest.raises(StopError, match=refused), RunLock(str(tmp_path)):
            pass
        assert driver_alive(str(tmp_path)), "a refused driver leaves the lock alone"
        first.check()
    assert not driver_alive(str(tmp_path))
    with RunLock(str(tmp_path)) as second:
        assert (first.epoch, second.epoch) == (1, 2)


def test_of_many_drivers_that_begin_at_once_one_gets_the_run(tmp_path: Path) -> None:
    barrier, over, got = threading.Barrier(8), threading.Event(), list[object]()

    def begin() -> None:
        barrier.wait()
        try:
            with RunLock(str(tmp_path)) as held:
                got.append(held.epoch)
                over.wait(10)
        except StopError as error:
            got.append(error)
            if len(got) == 8:
                over.set()

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + 10
    while len(got) < 8 and time.monotonic() < deadline:
        time.sleep(0.01)
    over.set()
    for thread in threads:
        thread.join()
    assert [found for found in got if found == 1] == [1]
    assert len(got) == 8


def test_lock_of_a_process_that_ended_is_taken_over_at_once(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "pass"]) as ended:
        ended.wait()
    write_claim(tmp_path, **here(pid=ended.pid))
    assert not driver_alive(str(tmp_path))
    with RunLock(str(tmp_path)) as held:
        assert held.epoch == 2
        assert driver_alive(str(tmp_path))


def test_lock_of_a_process_whose_id_was_used_again_is_taken_over_at_once(tmp_path: Path) -> None:
    write_claim(tmp_path, **here(pid=os.getpid(), started="12345"))
    with RunLock(str(tmp_path)):
        pass


@pytest.mark.usefixtures("quick")
def test_same_process_id_in_another_container_is_watched_and_not_looked_up(tmp_path: Path) -> None:
    mine = lock._process(os.getpid())
    write_claim(tmp_path, host=socket.gethostname(), space="another boot 7", pid=os.getpid(), started=mine.started)
    assert not driver_alive(str(tmp_path)), "it does not beat, whatever this machine's process of that number does"


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S], ids=["an hour ahead", "an hour behind"])
def test_driver_elsewhere_lives_while_it_beats_whatever_its_clock_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jump_s: float
) -> None:
    write_claim(tmp_path)
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + jump_s)
    with beating(tmp_path, 1, now() + 2 * jump_s):
        assert driver_alive(str(tmp_path))
        with pytest.raises(StopError, match="process 1 on elsewhere"), RunLock(str(tmp_path)):
            pass
    told: list[str] = []
    before = time.monotonic()
    with RunLock(str(tmp_path), told.append) as held:
        assert time.monotonic() - before >= lock.ABANDONED_S
        assert held.epoch == 2
    assert len(told) == 1
    assert "process 1 on elsewhere is still at work" in told[0]


@pytest.mark.usefixtures("quick")
def test_driver_that_sleeps_on_this_machine_is_taken_over_after_a_while(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as asleep:
        write_claim(tmp_path, **here(pid=asleep.pid, started=lock._process(asleep.pid).started))
        assert driver_alive(str(tmp_path)), "a process that runs is asked for no beat"
        with paused(asleep.pid):
            while not lock._process(asleep.pid).asleep:
                time.sleep(0.01)
            with RunLock(str(tmp_path)) as held:
                assert held.epoch == 2
        asleep.kill()


def test_driver_whose_run_was_taken_may_commit_no_more(tmp_path: Path) -> None:
    with RunLock(str(tmp_path)) as stale:
        stale.check()
        write_claim(tmp_path, epoch=2, host="elsewhere", pid=77)
        with pytest.raises(FencedError, match=r"process 77 on elsewhere took this run over.*session 1"):
            stale.check()
        assert stale.lost
    assert read_holder(str(tmp_path)).epoch == 2, "leaving does not give the other one's run away"  # type: ignore


@pytest.mark.usefixtures("quick")
def test_beat_moves_on_and_finds_that_the_run_was_taken(tmp_path: Path) -> None:
    with RunLock(str(tmp_path)) as stale:
        first = lock._read_pulse(str(tmp_path), 1)[0]
        deadline = time.monotonic() + 10
        while lock._read_pulse(str(tmp_path), 1)[0] == first:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        write_claim(tmp_path, epoch=2)
        while not stale.lost:
            assert time.monotonic() < deadline
            time.sleep(0.01)
    assert lock._read_pulse(str(tmp_path), 2) == (1, False), "the other driver's beat is its own"


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("text", ["", "{", "[]", '{"pid": "x"}', '{"host": "elsewhere"}'])
def test_claim_that_says_nothing_stops_nobody_for_long(tmp_path: Path, text: str) -> None:
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "000004.json").write_text(text)
    with RunLock(str(tmp_path)) as held:
        assert held.epoch == 5


@pytest.mark.usefixtures("quick")
def test_beat_that_cannot_be_written_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(uri: str, data: bytes) -> None:
        raise StopError(f"{uri}: No space left on device")

    with RunLock(str(tmp_path)) as held:
        monkeypatch.setattr(lock.storage, "write_bytes_atomic", full)
        time.sleep(0.1)
        held.check()
        assert held._beating.is_alive()


def test_lock_that_could_not_say_that_it_ended_is_free_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(uri: str, data: bytes) -> None:
        raise StopError(f"{uri}: No space left on device")

    with monkeypatch.context() as patch, RunLock(str(tmp_path)):
        patch.setattr(lock.storage, "write_bytes_atomic", full)
    with RunLock(str(tmp_path)) as held:
        assert held.epoch == 2


def test_each_session_of_a_run_has_a_later_epoch_in_its_manifests(
    make_scene: Callable[..., Path], make_job: MakeJob
) -> None:
    make_scene("a", ["q", "z", "y", "x"])
    run = submit(make_job(), steps=STEPS).run
    first = load_manifest(run, committed_units(run)[0])
    assert first.epoch == 1
    discard_unit(run, first.unit, epoch=1)
    resume(run, steps=STEPS)
    assert load_manifest(run, first.unit).epoch == 2
