"""Builds that compute nothing: steps that take a moment, a checkpoint, and the faults a capture's name asks for."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from schemas.build_plan import PlannedCapture
from schemas.calls import TimingRow
from schemas.errors import InputError, RetryError, StoppedError
from workers.build_steps import BuildWork, ProgressFile, StopFiles, failed_build
from workers.steps import Tables

STEPS = 20

STEP_S = "FAKE_BUILDS_STEP_S"
"""Environment variable with the seconds of a step; 0 without."""

MARKS = "FAKE_BUILDS_MARKS"
"""Environment variable with a folder in which every step of a capture leaves a line, whoever does it."""


def fake_build(work: BuildWork, capture: PlannedCapture, stop: Callable[[], bool]) -> Tables:
    """Do the steps that the checkpoint lacks, then write scene.json."""
    name = capture.scene
    if "wrong" in name:
        raise InputError(capture.capture, field="depth", expected="depth", found="none")
    if "bug" in name:
        raise ZeroDivisionError("a bug")
    marks = Path(os.environ[MARKS])
    if "lost" in name and not (marks / f"{name}.lost").exists():
        (marks / f"{name}.lost").touch()
        raise RetryError("the network")
    folder, asked = work.folder(capture.unit), StopFiles(work.stops)
    shown, checkpoint = ProgressFile(folder, name), folder / "checkpoint"
    done = int(checkpoint.read_text()) if checkpoint.exists() else 0
    for step in range(done, STEPS):
        if stop() or asked():
            raise StoppedError(f"after {step}")
        time.sleep(float(os.environ.get(STEP_S, "0")))
        with (marks / name).open("a") as lines:
            lines.write(f"{os.getpid()} {step}\n")
        aside = checkpoint.with_name(f"checkpoint.{os.getpid()}.tmp")
        aside.write_text(str(step + 1))
        aside.replace(checkpoint)
        shown.tell("train", step / STEPS, f"step {step} of {STEPS}")
    scene = Path(capture.scene_uri)
    scene.mkdir(parents=True, exist_ok=True)
    (scene / "scene.json").write_text(name)
    (row,) = failed_build(capture, ValueError())["builds"]
    made = replace(row, status="built", reason="", start="depth", frames=4, fitted=4, steps=STEPS, psnr=20.0)
    return {"builds": (made,), "timings": (TimingRow("", name, "train", 0.5, 1),)}


def steps_done(marks: Path, name: str, here: bool = False) -> list[int]:
    """Return the steps a capture's builds have done, in order; those of this process alone if `here`."""
    path = marks / name
    lines = [line.split() for line in path.read_text().splitlines()] if path.exists() else []
    return [int(step) for pid, step in lines if not here or pid == str(os.getpid())]
