"""`splatreasoner curate`: a referring set from scene folders that a job takes as its dataset."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jobs.config import JobConfig
from jobs.runs.plan import plan_units
from jobs.scenes.curate import curate_scenes
from pipeline.datasets import curate_referring, load_dataset_questions
from pipeline.scene.objects import SceneObject
from pipeline.scene.save import save_scene
from schemas.errors import InputError
from tests.jobs.test_cli import one_line, run
from tests.query.tiny import tiny_scene
from tests.scene.home import build_home

KITCHEN = tuple(o for o in build_home() if o.room == "kitchen")


def _scene(folder: Path, objects: tuple[SceneObject, ...] = KITCHEN) -> str:
    save_scene(tiny_scene(folder.name), str(folder), objects)
    return str(folder)


def test_verb_writes_the_set_of_the_function_and_a_job_asks_it(tmp_path: Path) -> None:
    scene, file = _scene(tmp_path / "scenes" / "home"), str(tmp_path / "referring.jsonl")
    found = run("curate", scene, "--output", file, "--count", "3", "--seed", "5")
    assert found.returncode == 0, found.stderr
    assert one_line(found.stdout).startswith(f"{file}: 3 questions, 1 scene, 4 to 4 ")
    made = curate_referring({"home": KITCHEN}, np.random.default_rng(5), count=3)
    assert load_dataset_questions("referring", file) == made.questions
    dataset = {"kind": "referring", "path": file, "roots": [str(tmp_path / "scenes")]}
    job = JobConfig.model_validate({"name": "t", "output": str(tmp_path / "run"), "dataset": dataset})
    assert [q for unit in plan_units(job) for q in unit.questions] == list(made.questions)


def test_verb_says_when_there_are_fewer_than_asked_for(tmp_path: Path) -> None:
    scene = _scene(tmp_path / "home", KITCHEN[:30])
    found = run("curate", scene, "--output", tmp_path / "few.jsonl", "--count", "5000")
    assert found.returncode == 0, found.stderr
    assert "of 5000: the scenes have no more" in found.stdout.splitlines()[1]


def test_every_bad_scene_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    good, bare = _scene(tmp_path / "home"), _scene(tmp_path / "bare", ())
    twin = _scene(tmp_path / "elsewhere" / "home")
    with pytest.raises(InputError, match="found nothing at ") as refused:
        curate_scenes([good, bare, twin, str(tmp_path / "none")], str(tmp_path / "set.jsonl"), count=3)
    notes = "\n".join(refused.value.__notes__)
    assert f"{bare}: objects.json: expected the scene's objects, found none" in notes
    assert f"{twin}: name: expected a name no other scene has, found home" in notes
    assert not (tmp_path / "set.jsonl").exists()


def test_scenes_in_which_nothing_can_be_told_apart_are_refused(tmp_path: Path) -> None:
    apart = tuple(replace(o, category=f"thing {number}") for number, o in enumerate(KITCHEN))
    with pytest.raises(InputError, match="told from 1 or more others of its category, found none in home"):
        curate_scenes([_scene(tmp_path / "home", apart)], str(tmp_path / "set.jsonl"), count=3)
