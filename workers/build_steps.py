"""What builds one capture inside a worker: the call of the pipeline, its rows, and files by which both sides talk.

A worker tells how far it is in `progress.json` in the working folder of its capture, and ends with what it has kept
once one of the stop files of its session is there. Plain files serve this process, a Ray worker and another node with
the same disk alike.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas.build_plan import PlannedCapture
from schemas.builds import BuildRow
from schemas.calls import TimingRow
from workers.steps import Tables

PROGRESS_FILE = "progress.json"

TELL_S = 1.0
"""Seconds between two writes of a capture's progress within a stage."""

LOOK_S = 0.5
"""Seconds between two looks for the stop file."""


@dataclass(frozen=True, slots=True)
class BuildWork:
    """What every worker of a build run needs; pickled once and small."""

    config: Any
    """BuildConfig."""
    questions: str
    """Question file whose lines are copied into the scenes they are about; empty for none."""
    working: str
    """Local folder of checkpoints and progress, one folder a unit."""
    stops: tuple[str, ...]
    """Files of which any ends the work of this session once it is there: someone asked for it, or another driver has
    taken the run while a worker of this one lives on."""
    threads: int
    """Threads of one capture."""

    def folder(self, unit: str) -> Path:
        """Return the working folder of a unit."""
        return Path(self.working, unit)


Build = Callable[[BuildWork, PlannedCapture, Callable[[], bool]], Tables]
"""Builds a capture: what the run needs, the capture, and whether to stop; gives its records. Module-level, so that it
pickles by name; tests put fakes in its place."""


def build_scene(work: BuildWork, capture: PlannedCapture, stop: Callable[[], bool]) -> Tables:
    """Build a capture's scene and return its records.

    Raises:
        InputError: The capture is wrong.
        StoppedError: `stop`, or a stop file, said so.
    """
    from pipeline.construct.build_capture import BuildProgress, build_capture
    from schemas.question_file import load_questions

    folder, asked = work.folder(capture.unit), StopFiles(work.stops)
    _clear_aside(folder)
    shown = ProgressFile(folder, capture.scene)
    questions = load_questions(work.questions) if work.questions else ()

    def tell(found: BuildProgress) -> None:
        shown.tell(found.stage, found.share, found.detail)

    record = build_capture(
        capture.capture,
        work.config,
        capture.scene_uri,
        kind=capture.kind,  # type: ignore[arg-type]  # checked when it was planned
        name=capture.scene,
        questions=[question for question in questions if question.scene == capture.scene],
        checkpoint=folder,
        threads=work.threads,
        progress=tell,
        stop=lambda: stop() or asked(),
    )
    times = tuple(TimingRow("", capture.scene, stage, seconds, 1) for stage, seconds in record.seconds.items())
    return {"builds": (record.row,), "timings": times}


def _clear_aside(folder: Path) -> None:
    """Remove what a killed worker was writing: nobody renames it any more."""
    for left in (*folder.glob("*.part"), *folder.glob(f"{PROGRESS_FILE}.*.tmp")):
        left.unlink(missing_ok=True)


def failed_build(capture: PlannedCapture, error: Exception) -> Tables:
    """Return the records of a capture that could not be built."""
    row = BuildRow(
        scene=capture.scene,
        capture=capture.capture,
        scene_uri=capture.scene_uri,
        status="failed",
        reason=f"{type(error).__name__}: {error}",
        start="",
        frames=0,
        fitted=0,
        held_out=0,
        skipped=0,
        started=0,
        gaussians=0,
        steps=0,
        psnr=None,
        ssim=None,
        depth_error_m=None,
        depth_within_5cm=None,
        labels="",
        categories=0,
        labelled=0.0,
        questions=0,
        warnings=(),
        photos_moved=0,
        aligned_psnr=None,
        aligned_ssim=None,
        exposed_psnr=None,
        objects=0,
    )
    return {"builds": (row,)}


class StopFiles:
    """Whether any of some files is there, looked up now and then; once one was it stays so.

    Args:
        paths: The files, local.
        clock: Seconds that only grow.
    """

    def __init__(self, paths: Sequence[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._paths, self._clock = paths, clock
        self._looked, self._there = float("-inf"), False

    def __call__(self) -> bool:
        """Return whether the work is to stop."""
        now = self._clock()
        if not self._there and now - self._looked >= LOOK_S:
            self._looked, self._there = now, any(map(os.path.exists, self._paths))
        return self._there


@dataclass(frozen=True, slots=True)
class CaptureProgress:
    """How far a capture is, as its worker told last."""

    scene: str
    """Name of the scene."""
    stage: str
    """Stage of the build."""
    share: float
    """Of that stage, 0 to 1."""
    detail: str
    """What else is known."""

    def __str__(self) -> str:
        """Return it as a line for a person."""
        return f"{self.scene}: {self.stage} {self.share:.0%}" + (f", {self.detail}" if self.detail else "")


class ProgressFile:
    """Tells how far a capture is, in a file of its working folder.

    Args:
        folder: The working folder; made where it is missing.
        scene: Name of the scene.
        clock: Seconds that only grow.
    """

    def __init__(self, folder: Path, scene: str, clock: Callable[[], float] = time.monotonic) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path, self._scene, self._clock = folder / PROGRESS_FILE, scene, clock
        self._stage, self._told = "", float("-inf")

    def tell(self, stage: str, share: float, detail: str = "") -> None:
        """Take in how far it is; it is written when a stage begins and every `TELL_S` seconds."""
        now = self._clock()
        if stage == self._stage and now - self._told < TELL_S:
            return
        self._stage, self._told = stage, now
        # A worker that outlived its driver may still write beside this one for a moment.
        aside = self._path.with_name(f"{PROGRESS_FILE}.{os.getpid()}.tmp")
        aside.write_text(json.dumps({"scene": self._scene, "stage": stage, "share": share, "detail": detail}))
        aside.replace(self._path)


def read_progress(working: Path) -> tuple[CaptureProgress, ...]:
    """Return how far each capture under way is, by name; a file nobody of ours wrote is passed over."""
    found = []
    for path in sorted(working.glob(f"*/{PROGRESS_FILE}")):
        try:
            found.append(CaptureProgress(**json.loads(path.read_text())))
        except (OSError, ValueError, TypeError):
            continue
    return tuple(sorted(found, key=lambda one: one.scene))
