from __future__ import annotations

from pathlib import Path

from jobs.events import EVENTS_FILE, EventLog, read_events


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
