"""The likeliest mistakes and what a person is told: docs/errors.md is the list, each row of it is tried here."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.scene.save import save_scene
from tests.conftest import ROOT
from tests.jobs.test_cli import run
from tests.scene.making import small_scene

PAGE = ROOT / "docs" / "errors.md"
QUESTION = {
    "question_id": "q1",
    "scene": "kitchen",
    "task": "eqa",
    "question": "What is on the table?",
    "answer": "A cup",
}
ENDPOINT = {"kind": "openai", "base_url": "http://127.0.0.1:9/v1", "model": "m"}
JOB: dict[str, Any] = {"name": "test", "output": "run", "scenes": "kitchen", "workers": {"in_process": True}}
NOT_AN_ERROR = {"job without a model server": 1, "scene without categories": 1, "one pose is no rotation": 0}
"""Exit codes that are not 2: work was begun and failed, or goes on."""

Arguments = tuple[str | Path, ...]


class Place:
    """A folder with a scene `kitchen` and a job of one question, whole until a mistake is made in it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.scene = folder, folder / "kitchen"
        save_scene(small_scene("kitchen"), str(self.scene))
        self.questions(QUESTION)

    def job(self, **changes: Any) -> Path:
        """Write job.yaml with some fields changed."""
        return self.text(yaml.safe_dump({**JOB, **changes}))

    def text(self, text: str) -> Path:
        """Write job.yaml."""
        (self.folder / "job.yaml").write_text(text)
        return self.folder / "job.yaml"

    def questions(self, *rows: dict[str, Any]) -> Path:
        """Write the scene's question file; return a job that asks it."""
        (self.scene / "questions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        return self.job()

    def cameras(self, change: Callable[[dict[str, Any]], object]) -> Path:
        """Change transforms.json; return the scene."""
        file = self.scene / "transforms.json"
        found = json.loads(file.read_text())
        change(found)
        file.write_text(json.dumps(found))
        return self.scene

    def without(self, name: str) -> Path:
        """Remove a file of the scene; return the scene."""
        (self.scene / name).unlink()
        return self.scene


def endpoint(**changes: Any) -> dict[str, Any]:
    return {"default": "gpt", "endpoints": {"gpt": {**ENDPOINT, **changes}}, "retry": {"max_tries": 1}}


def truncate(place: Place) -> Arguments:
    file = place.scene / "gaussians.ply"
    file.write_bytes(file.read_bytes()[:2000])
    return ("check", place.scene)


def second_splat_file(place: Place) -> Arguments:
    place.without("scene.json")
    (place.scene / "gaussians.splat").write_bytes(bytes(32))
    return ("check", place.scene)


def other_job_in_the_folder(place: Place) -> Arguments:
    assert run("submit", place.job()).returncode == 0
    return ("submit", place.job(method={"novel_views": {"count": 2}}))


def list_of_questions(place: Place) -> Arguments:
    (place.scene / "questions.jsonl").write_text(json.dumps([QUESTION], indent=1))
    return ("submit", place.job())


MISTAKES: dict[str, Callable[[Place], Arguments]] = {
    "verb misspelt": lambda _: ("sumbit", "job.yaml"),
    "option misspelt": lambda _: ("status", "run", "--wacth"),
    "job file that is not there": lambda place: ("submit", place.folder / "jobs.yaml"),
    "scene folder in place of a job file": lambda place: ("submit", place.scene),
    "scene folder in place of a run": lambda place: ("status", place.scene),
    "splat file in place of a scene folder": lambda place: ("check", place.scene / "gaussians.ply"),
    "tab in a job file": lambda place: ("submit", place.text("name: test\nworkers:\n\tcpus: 2\n")),
    "field misspelt": lambda place: ("submit", place.job(metod={})),
    "field in the wrong section": lambda place: ("submit", place.job(method={"cpus": 2})),
    "word where a number belongs": lambda place: ("submit", place.job(limit="many")),
    "no output": lambda place: ("submit", place.text("name: test\nscenes: kitchen\n")),
    "output is the scene": lambda place: ("submit", place.job(output="kitchen")),
    "pattern that matches no scene": lambda place: ("submit", place.job(scenes="scenes/*")),
    "number of novel views without moves": lambda place: ("submit", place.job(method={"novel_views": {"count": 3}})),
    "changed job, same output": other_job_in_the_folder,
    "questions as a JSON list": list_of_questions,
    "field of a question misspelt": lambda place: ("submit", place.questions({**QUESTION, "reference": "A cup"})),
    "question without a task": lambda place: (
        "submit",
        place.questions({name: value for name, value in QUESTION.items() if name != "task"}),
    ),
    "two questions of one id": lambda place: ("submit", place.questions(QUESTION, QUESTION)),
    "question about another scene": lambda place: ("submit", place.questions({**QUESTION, "scene": "bath"})),
    "scene without cameras": lambda place: ("check", place.without("transforms.json")),
    "distorted camera": lambda place: ("check", place.cameras(lambda found: found.update(k1=0.1))),
    "one pose is no rotation": lambda place: (
        "check",
        place.cameras(lambda found: found["frames"][0]["transform_matrix"][0].__setitem__(0, 5.0)),
    ),
    "splat file cut off": truncate,
    "two splat files": second_splat_file,
    "scene without categories": lambda place: ("submit", place.without("semantics.parquet") and place.job()),
    "model that no endpoint is": lambda place: ("submit", place.job(models={"default": "gpt-4o"})),
    "key pasted into the job file": lambda place: ("submit", place.job(models=endpoint(key_env="sk-proj-a1b2"))),
    "key that is not set": lambda place: ("submit", place.job(models=endpoint(key_env="MISTAKEN_API_KEY"))),
    "cap on money without prices": lambda place: ("submit", place.job(models=endpoint(), budget={"usd": 5})),
    "job without a model server": lambda place: ("submit", place.job(models=endpoint())),
    "picture from a camera that is not there": lambda place: (
        "render",
        place.scene,
        "--camera",
        "front",
        "--output",
        "out",
    ),
    "build without an output": lambda _: ("build", "--procedural", "3"),
}


def documented() -> dict[str, str]:
    """Return what docs/errors.md says of each mistake, by title."""
    rows = re.findall(r"^\| (.+?) \| `(.+)` \| .+ \|$", PAGE.read_text(), re.MULTILINE)
    return {title: message.replace("\\|", "|") for title, message in rows}


def told(arguments: Arguments, folder: Path) -> tuple[int, str]:
    """Return the exit code and all that is printed, with paths as seen from the folder."""
    found = run(*arguments)
    printed = (found.stdout + found.stderr).replace(f"{folder}/", "").replace(str(folder), ".")
    # A box of the option parser wraps its text.
    return found.returncode, " ".join(printed.replace("│", " ").split())


def test_page_lists_the_mistakes_that_are_tried() -> None:
    assert list(documented()) == list(MISTAKES)
    assert len(MISTAKES) >= 30


@pytest.mark.parametrize("title", MISTAKES)
def test_mistake_is_answered_as_the_page_says(title: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MISTAKEN_API_KEY", raising=False)
    code, printed = told(MISTAKES[title](Place(tmp_path)), tmp_path)
    expected = ".*?".join(map(re.escape, documented()[title].split("...")))
    assert re.search(expected, printed), printed
    assert "Traceback" not in printed
    assert code == NOT_AN_ERROR.get(title, 2)


def test_pasted_key_is_never_printed(tmp_path: Path) -> None:
    place = Place(tmp_path)
    for changes in ({"key_env": "sk-proj-a1b2"}, {"base_url": "https://me:a1b2@host/v1"}):
        _, printed = told(("submit", place.job(models=endpoint(**changes))), tmp_path)
        assert "a1b2" not in printed
