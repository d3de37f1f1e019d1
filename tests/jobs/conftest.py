"""Small jobs with fake steps: the splat file is never opened, so a few bytes stand for it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from pipeline.scene.load import load_objects
from schemas.question_file import load_questions, save_questions
from tests.conftest import ROOT
from tests.jobs.blobs import balls as balls
from tests.jobs.blobs import balls_run as balls_run
from tests.jobs.chaos.measured import measured as measured
from tests.workers.fake_steps import MARKS, unit

CAMERAS: dict[str, Any] = {
    **{"w": 4, "h": 3, "fl_x": 4.0, "fl_y": 4.0, "cx": 2.0, "cy": 1.5},
    "frames": [{"file_path": "1.png", "transform_matrix": [[float(i == j) for j in range(4)] for i in range(4)]}],
}
"""A transforms.json with one view."""

MakeJob = Callable[..., JobConfig]

EVERY_NTH = 12
"""Questions of the apartment that are kept: some of every task, few enough for seconds."""


@pytest.fixture
def make_scene(tmp_path: Path) -> Callable[..., Path]:
    """Make a scene folder with questions of the given texts."""

    def make(name: str, texts: list[str]) -> Path:
        folder = tmp_path / "scenes" / name
        folder.mkdir(parents=True)
        (folder / "gaussians.ply").write_bytes(f"splats of {name}".encode())
        (folder / "transforms.json").write_text(json.dumps(CAMERAS))
        save_questions(unit(0, texts, name).questions, folder / "questions.jsonl")
        return folder

    return make


@pytest.fixture
def make_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeJob:
    """Make a job over the scenes made so far, run in this process unless told otherwise."""
    marks = tmp_path / "marks"
    marks.mkdir()
    monkeypatch.setenv(MARKS, str(marks))

    def make(run: str = "run", **changes: Any) -> JobConfig:
        workers = {"in_process": True, "chunk": 3, "cpus": 2, **changes.pop("workers", {})}
        values = {"name": "test", "output": str(tmp_path / run), "scenes": str(tmp_path / "scenes" / "*")}
        return JobConfig.model_validate({**values, "workers": workers, **changes})

    return make


@pytest.fixture(scope="session")
def apartment(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A small generated apartment with few questions; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("scenes") / "flat"
    # In a process of its own, as a person would: generating is slow under the shape checks of the tests.
    code = "import sys; from jobs.cli import main; main()"
    options = ["--procedural", "5", "--output", str(folder), "--gaussians", "12000", "--rooms", "2", "--views", "20"]
    command = [sys.executable, "-c", code, "build", *options]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    questions = load_questions(folder / "questions.jsonl")
    assert f"20 views, {len(load_objects(str(folder)))} objects, {len(questions)} questions" in built.stdout
    save_questions(questions[::EVERY_NTH], folder / "questions.jsonl")
    return str(folder)
