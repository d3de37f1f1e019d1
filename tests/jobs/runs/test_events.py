from __future__ import annotations

from pathlib import Path

import pyarrow.fs
import pytest

from jobs.runs.events import EVENTS_FILE, FLUSH_S, EventLog, read_events
from schemas import object_store


def test_events_come_back_in_order_and_sessions_append(tmp_path: Path) -> None:
    for session in (1, 2):
        log = EventLog(str(tmp_path / "run"))
        log.note("started", session=session)
        log.note("failed", message="Gürtel\nzweite Zeile")
        log.close()
    found = list(read_events(str(tmp_path / "run")))
    assert [(e["event"], e.get("session"), e.get("message")) for e in found] == [
        ("started", 1, None),
        ("failed", None, "Gürtel\nzweite Zeile"),
        ("started", 2, None),
        ("failed", None, "Gürtel\nzweite Zeile"),
    ]


def test_line_cut_short_by_a_crash_is_passed_over(tmp_path: Path) -> None:
    log = EventLog(str(tmp_path))
    log.note("started")
    with (tmp_path / EVENTS_FILE).open("a") as stream:
        stream.write('{"time": "2026')
    assert [e["event"] for e in read_events(str(tmp_path))] == ["started"]


def test_run_without_events_has_none(tmp_path: Path) -> None:
    assert list(read_events(str(tmp_path))) == []


def test_line_cut_short_does_not_swallow_the_next_session(tmp_path: Path) -> None:
    (tmp_path / EVENTS_FILE).write_text('{"time": "2026-01-01", "event": "committed", "uni')
    log = EventLog(str(tmp_path))
    log.note("started")
    log.note("ended")
    assert [e["event"] for e in read_events(str(tmp_path))] == ["started", "ended"]


def test_diary_that_cannot_be_written_ends_nothing_and_is_written_later(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("a file where the run folder should be")
    log = EventLog(str(tmp_path / "run"))
    log.note("started")
    (tmp_path / "run").unlink()
    log.note("ended")
    log.close()
    assert [e["event"] for e in read_events(str(tmp_path / "run"))] == ["started", "ended"]


def test_diary_on_an_object_store_is_written_now_and_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "remote" / "bucket").mkdir(parents=True)
    store = pyarrow.fs.SubTreeFileSystem(str(tmp_path / "remote"), pyarrow.fs.LocalFileSystem())
    monkeypatch.setattr(object_store, "filesystem", lambda uri: (store, str(uri).removeprefix("fake://")))
    now, run = [0.0], "fake://bucket/run"
    log = EventLog(run, lambda: now[0])
    log.note("started")
    assert list(read_events(run)) == []
    now[0] = FLUSH_S
    log.note("committed", unit="a")
    log.note("committed", unit="b")
    assert [e.get("unit") for e in read_events(run)] == [None, "a"]
    log.close()
    assert [e.get("unit") for e in read_events(run)] == [None, "a", "b"]
