"""Small jobs with fake steps: the splat file is never opened, so a few bytes stand for it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from schemas.question_file import save_questions
from tests.jobs.chaos.measured import measured as measured
from tests.workers.fake_steps import MARKS, unit

CAMERAS: dict[str, Any] = {
    **{"w": 4, "h": 3, "fl_x": 4.0, "fl_y": 4.0, "cx": 2.0, "cy": 1.5},
    "frames": [{"file_path": "1.png", "transform_matrix": [[float(i == j) for j in range(4)] for i in range(4)]}],
}
"""A transforms.json with one view."""

MakeJob = Callable[..., JobConfig]


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
