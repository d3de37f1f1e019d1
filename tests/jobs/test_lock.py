from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from jobs import lock
from jobs.lock import LOCK_FILE, RunLock, driver_alive
from schemas.errors import StopError


def write_lock(run: Path, **changes: Any) -> None:
    holder = {"owner": "other", "host": socket.gethostname(), "pid": os.getpid(), "started": "", "beat": time.time()}
    (run / LOCK_FILE).write_text(json.dumps({**holder, **changes}))


def test_lock_is_held_in_the_block_and_gone_after_it(tmp_path: Path) -> None:
    with RunLock(str(tmp_path)):
        assert driver_alive(str(tmp_path))
        with pytest.raises(StopError, match=f"process {os.getpid()} on {socket.gethostname()}"), RunLock(str(tmp_path)):
            pass
        assert driver_alive(str(tmp_path)), "a refused driver leaves the lock alone"
    assert not (tmp_path / LOCK_FILE).exists()
    with RunLock(str(tmp_path)):
        pass


def test_lock_of_a_process_that_ended_is_taken_over(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "pass"]) as ended:
        ended.wait()
    write_lock(tmp_path, pid=ended.pid)
    assert not driver_alive(str(tmp_path))
    with RunLock(str(tmp_path)):
        assert driver_alive(str(tmp_path))


def test_lock_of_a_process_whose_id_was_used_again_is_taken_over(tmp_path: Path) -> None:
    write_lock(tmp_path, started="12345")
    with RunLock(str(tmp_path)):
        pass


@pytest.mark.parametrize(("age_s", "alive"), [(1.0, True), (lock.ABANDONED_S * 2, False)])
def test_driver_on_another_machine_lives_as_long_as_its_heartbeat(tmp_path: Path, age_s: float, alive: bool) -> None:
    write_lock(tmp_path, host="elsewhere", pid=1, beat=time.time() - age_s)
    assert driver_alive(str(tmp_path)) == alive


def test_heartbeat_moves_on_and_never_over_another_driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "BEAT_S", 0.02)
    with RunLock(str(tmp_path)):
        first = json.loads((tmp_path / LOCK_FILE).read_text())["beat"]
        deadline = time.monotonic() + 10
        while json.loads((tmp_path / LOCK_FILE).read_text())["beat"] == first:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        write_lock(tmp_path, owner="thief")
        time.sleep(0.1)
        assert json.loads((tmp_path / LOCK_FILE).read_text())["owner"] == "thief"
    assert (tmp_path / LOCK_FILE).exists(), "a lock that is not ours stays"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"pid": "x"}', '{"host": "elsewhere"}'])
def test_lock_file_that_says_nothing_stops_nobody(tmp_path: Path, text: str) -> None:
    (tmp_path / LOCK_FILE).write_text(text)
    with RunLock(str(tmp_path)):
        assert driver_alive(str(tmp_path))


def test_of_two_drivers_that_begin_at_once_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Both have looked and found nothing before either writes.
    monkeypatch.setattr(lock, "read_lock", lambda uri: None)
    monkeypatch.setattr(lock.storage, "exists", lambda uri: False)
    with RunLock(str(tmp_path)), pytest.raises(StopError, match="at the same moment"), RunLock(str(tmp_path)):
        pass
