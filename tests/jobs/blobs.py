"""A scene of two balls and a run that asked for one of them: a real run of few seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from jobs.config import JobConfig
from jobs.runs.submit import submit
from pipeline.geometry import Camera
from pipeline.scene.gaussians import Gaussians
from pipeline.scene.save import save_scene
from pipeline.scene.scene import Scene
from pipeline.scene.semantics import Semantics
from pipeline.scene.views import View
from schemas.question_file import save_questions
from schemas.questions import Question

HOSTILE = "This is the ball. <img src=x onerror=\"document.title='owned'\">"
"""Text of a question that a page must not run."""
PHOTO = (200, 30, 30)
"""Colour of the one photograph."""
EACH = 40
"""Gaussians a ball."""


def save_balls(folder: Path) -> Path:
    """Save two balls of Gaussians, 2 m apart, that one camera sees side by side from 3 m; return the scene's folder."""
    rng = np.random.default_rng(0)
    means = rng.normal(0, 0.05, (2 * EACH, 3)).astype(np.float32)
    means[:EACH, 0] -= 1
    means[EACH:, 0] += 1
    gaussians = Gaussians(
        means,
        np.tile(np.array([1, 0, 0, 0], np.float32), (2 * EACH, 1)),
        np.full((2 * EACH, 3), np.log(0.04), np.float32),
        np.full(2 * EACH, 4.0, np.float32),
        rng.normal(0, 0.5, (2 * EACH, 1, 3)).astype(np.float32),
    )
    instance = np.repeat([0, 1], EACH).astype(np.int32)
    semantics = Semantics(("ball",), np.zeros(2 * EACH, np.int32), None, instance)
    pose = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 3.0]])  # at y = -3, looking along +y
    camera = Camera(np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]]), pose, 64, 48)
    save_scene(Scene("balls", gaussians, (View("front", camera),), semantics), str(folder / "balls"))
    (folder / "balls" / "images").mkdir()
    Image.fromarray(np.full((48, 64, 3), PHOTO, np.uint8)).save(folder / "balls" / "images" / "front.png")
    return folder / "balls"


def ask_for_ball(scene: Path, run: Path) -> str:
    """Ask for the second ball, in this process, and return the run."""
    asked = [
        Question("one/ball", "balls", "ground_one", HOSTILE, target_ids=(1,), target_category="ball"),
        Question("count", "balls", "eqa", "How many balls are there?", answer="2"),
    ]
    save_questions(asked, scene / "questions.jsonl")
    values = {"name": "balls", "output": str(run), "scenes": str(scene), "workers": {"in_process": True}}
    return submit(JobConfig.model_validate(values)).run


@pytest.fixture(scope="session")
def balls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene; tests leave it as it is."""
    return save_balls(tmp_path_factory.mktemp("balls"))


@pytest.fixture(scope="session")
def balls_run(balls: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The run over it; tests leave it as it is."""
    return ask_for_ball(balls, tmp_path_factory.mktemp("balls-run") / "run")
