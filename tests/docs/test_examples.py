"""The Python of README and docs does what the pages say, and the commands they show have the options they use."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command

from jobs.cli import VERBS, app
from jobs.config import JobConfig, checked_job
from jobs.runs.submit import submit
from pipeline.scene.scene import Scene
from schemas.builds import BUILDS
from tests.conftest import ROOT
from tests.jobs.blobs import save_balls
from tests.jobs.conftest import make_job, make_scene
from tests.scene.making import camera, small_scene
from tests.workers.fake_steps import STEPS

__all__ = ["make_job", "make_scene"]
"""Fixtures that are used here."""

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NEEDS_FILES = {"datasets.md": "the official OpenEQA file"}
"""Pages whose Python reads what is not ours to ship; it is compiled all the same."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)


def a_scene() -> dict[str, Any]:
    """Names the renderer's example takes for granted."""
    scene: Scene = small_scene()
    return {"scene": scene, "camera": camera(), "cameras": [camera(), camera((2.0, 1.0, 1.0))]}


PYTHON = {page.relative_to(ROOT).as_posix(): code for page in PAGES if (code := blocks(page, "python"))}


@pytest.mark.parametrize("page", PYTHON)
def test_python_of_a_page_runs(
    page: str,
    make_scene: Callable[..., Path],
    make_job: Callable[..., JobConfig],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for number, code in enumerate(PYTHON[page]):
        compile(code, f"{page} block {number}", "exec")
    name = Path(page).name
    if name in NEEDS_FILES:
        pytest.skip(f"needs {NEEDS_FILES[name]}")
    monkeypatch.chdir(tmp_path)
    known: dict[str, Any] = {"__name__": "example"}
    if name in ("README.md", "results.md", "prompts.md"):
        make_scene("a", ["q", "no evidence", "z"])
        for run in ("demo/run", "runs/scannet", "runs/base", "runs/explore"):
            submit(make_job(run), steps=STEPS)
    elif name == "scale.md":
        for number, scene in enumerate(("a", "b")):
            folder = make_scene(scene, ["q", "z"])
            submit(make_job(f"runs/shard-0{number}", scenes=[str(folder)]), steps=STEPS)
    elif name == "building.md":
        import pyarrow.parquet as pq

        Path("built/results").mkdir(parents=True)
        pq.write_table(BUILDS.arrow_schema().empty_table(), "built/results/builds.parquet")
    elif name == "pictures.md":
        save_balls(Path("demo/scenes")).rename("demo/scenes/apartment-101")
    elif name == "rendering.md":
        known |= a_scene()
    for number, code in enumerate(PYTHON[page]):
        exec(compile(code, f"{page} block {number}", "exec"), known)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_of_a_page_have_the_options_they_use(page: Path) -> None:
    verbs = get_command(app).commands  # type: ignore[attr-defined]
    for block in blocks(page, "console"):
        for line in re.findall(r"^\$ .*?splatreasoner (.+)$", block, re.MULTILINE):
            for command in re.split(r"&& \S*splatreasoner ", line):
                verb, *words = command.partition(" #")[0].split()
                if verb.startswith("--"):
                    continue
                assert verb in VERBS, f"{page.name}: {line}"
                known = {flag for one in verbs[verb].params for flag in [*one.opts, *one.secondary_opts]}
                used = {word.partition("=")[0] for word in words if word.startswith("--")}
                assert used <= known | {"--help"}, f"{page.name}: {line}"


def test_job_of_the_page_on_own_data_is_a_job() -> None:
    (text,) = blocks(ROOT / "docs" / "own_data.md", "yaml")
    assert checked_job(yaml.safe_load(text), "own_data.md").models.endpoint_of("answer_one") == "vision"
