"""What a worker that builds tells and looks for, and the two backends' answers to being given up."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from schemas.build_plan import PlannedCapture
from schemas.errors import StoppedError
from workers.build_here import BuildHere
from workers.build_steps import (
    LOOK_S,
    PROGRESS_FILE,
    BuildWork,
    CaptureProgress,
    ProgressFile,
    StopFiles,
    _clear_aside,
    failed_build,
    read_progress,
)
from workers.steps import Tables

CAPTURE = PlannedCapture("u1", 0, "kitchen", "captures/kitchen", "auto", "0" * 64, "scenes/kitchen")


def test_progress_is_written_when_a_stage_begins_and_then_once_a_second(tmp_path: Path) -> None:
    now = [0.0]
    shown = ProgressFile(tmp_path / "u1", "kitchen", clock=lambda: now[0])
    shown.tell("fuse", 0.0)
    shown.tell("fuse", 0.5)
    assert [str(one) for one in read_progress(tmp_path)] == ["kitchen: fuse 0%"]
    now[0] = 1.5
    shown.tell("fuse", 0.75)
    assert [str(one) for one in read_progress(tmp_path)] == ["kitchen: fuse 75%"]
    shown.tell("train", 0.1, "PSNR 20.00 dB")
    assert read_progress(tmp_path) == (CaptureProgress("kitchen", "train", 0.1, "PSNR 20.00 dB"),)


def test_two_workers_that_tell_of_one_capture_do_not_disturb_each_other(tmp_path: Path) -> None:
    mine = ProgressFile(tmp_path / "u1", "kitchen")
    mine.tell("fuse", 0.0)
    (tmp_path / "u1" / "progress.json.1.tmp").write_text("of another process")
    mine.tell("train", 0.0)
    assert [one.stage for one in read_progress(tmp_path)] == ["train"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"scene": "a"}'])
def test_progress_that_nobody_of_ours_wrote_is_passed_over(tmp_path: Path, text: str) -> None:
    ProgressFile(tmp_path / "u1", "kitchen").tell("fuse", 0.0)
    (tmp_path / "u2").mkdir()
    (tmp_path / "u2" / "progress.json").write_text(text)
    assert len(read_progress(tmp_path)) == 1
    assert read_progress(tmp_path / "nowhere") == ()


def test_what_a_killed_worker_was_writing_is_removed(tmp_path: Path) -> None:
    for name in ("checkpoint", "checkpoint.1f.part", f"{PROGRESS_FILE}.7.tmp"):
        (tmp_path / name).touch()
    _clear_aside(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint"]


def test_any_stop_file_ends_the_work_for_good_and_is_looked_for_now_and_then(tmp_path: Path) -> None:
    now = [0.0]
    stop = StopFiles([str(tmp_path / "stop"), str(tmp_path / "taken")], clock=lambda: now[0])
    assert not stop()
    (tmp_path / "taken").touch()
    assert not stop(), "it has just looked"
    now[0] += LOOK_S
    assert stop()
    (tmp_path / "taken").unlink()
    now[0] += LOOK_S
    assert stop()


def waiting(work: BuildWork, capture: PlannedCapture, stop: Callable[[], bool]) -> Tables:
    deadline = time.monotonic() + 20
    while not stop() and time.monotonic() < deadline:
        time.sleep(0.01)
    raise StoppedError("as asked") if stop() else TimeoutError


def quick(work: BuildWork, capture: PlannedCapture, stop: Callable[[], bool]) -> Tables:
    return failed_build(capture, ValueError("none"))


@pytest.fixture
def work(tmp_path: Path) -> BuildWork:
    return BuildWork(None, "", str(tmp_path), (), 1)


def test_capture_built_here_gives_its_records(work: BuildWork) -> None:
    here = BuildHere(work, quick)
    handle = here.submit(CAPTURE, (CAPTURE,))
    assert list(here.wait([handle], 20)) == [handle]
    (tables,) = here.result(handle).results
    assert not isinstance(tables, Exception)
    assert tables["builds"][0].reason == "ValueError: none"
    here.close()


def test_capture_that_is_given_up_ends_at_its_next_look(work: BuildWork) -> None:
    here = BuildHere(work, waiting)
    handle = here.submit(CAPTURE, (CAPTURE,))
    assert not here.wait([handle], 0.05)
    here.cancel(handle)
    assert list(here.wait([handle], 20)) == [handle]
    with pytest.raises(StoppedError):
        here.result(handle)
    here.close()


def test_closing_waits_for_what_is_under_way_and_begins_nothing_more(work: BuildWork) -> None:
    here = BuildHere(work, waiting)
    first, second = (here.submit(CAPTURE, (CAPTURE,)) for _ in range(2))
    here.close()
    assert first.done()
    assert second.cancelled()
