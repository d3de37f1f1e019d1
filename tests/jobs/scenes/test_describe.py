"""Categories from a 2D source onto a scene that is there already, also one without photographs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from jobs.cli import app
from jobs.scenes.describe import describe_scene
from pipeline.construct.semantics.describe import SemanticsConfig
from pipeline.scene.check import check_scene
from pipeline.scene.load import load_scene
from pipeline.scene.save import save_scene
from pipeline.scene.scene_file import BUILD
from schemas.errors import InputError
from schemas.question_file import load_questions, save_questions
from tests.scene.making import small_scene
from tests.workers.fake_steps import unit


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    save_scene(small_scene(), str(tmp_path / "flat"))
    save_questions(unit(0, ["Where?"], "flat").questions, tmp_path / "flat" / "questions.jsonl")
    return tmp_path / "flat"


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    folder = tmp_path / "labels"
    folder.mkdir()
    (folder / "names.json").write_text(json.dumps(["stove", "shelf"]))
    for view in small_scene().views:
        pixels = np.ones((view.camera.height, view.camera.width), np.uint8)
        Image.fromarray(pixels).save(folder / f"{view.name}.label.png")
    return folder


def test_scene_without_photographs_gets_categories_and_keeps_the_rest(
    scene: Path, labels: Path, tmp_path: Path
) -> None:
    told: list[tuple[int, int]] = []
    config = SemanticsConfig.model_validate({"source": {"kind": "label_files", "folder": str(labels)}})
    made = describe_scene(str(scene), config, str(tmp_path / "new"), progress=lambda *done: told.append(done))
    before, after = load_scene(str(scene)), load_scene(str(tmp_path / "new"))
    assert after.semantics.present() == ("shelf",)
    assert (made.categories, made.photographs, made.rendered) == (1, 0, 3)
    assert made.labelled == after.semantics.labelled_share > 0
    np.testing.assert_array_equal(after.gaussians.means, before.gaussians.means)
    assert before.semantics.instance is not None
    np.testing.assert_array_equal(after.semantics.instance, before.semantics.instance)
    assert load_questions(tmp_path / "new" / "questions.jsonl") == load_questions(scene / "questions.jsonl")
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_verb_label_takes_a_source_of_semantics(scene: Path, labels: Path, tmp_path: Path) -> None:
    options = [str(scene), "--semantics", f"label_files:{labels}", "--output", str(tmp_path / "new"), "--threads", "1"]
    result = CliRunner().invoke(app, ["label", *options], catch_exceptions=False)
    assert result.exit_code == 0
    assert "1 categories, seen on 0 photographs and 3 renders" in result.stdout


@pytest.mark.parametrize("options", [[], ["--from", "a", "--semantics", "ssd_mobilenet"]])
def test_verb_label_needs_one_source(scene: Path, options: list[str]) -> None:
    result = CliRunner().invoke(app, ["label", str(scene), "--output", "x", *options])
    assert isinstance(result.exception, InputError)


def test_scene_is_not_described_onto_itself(scene: Path, labels: Path) -> None:
    config = SemanticsConfig.model_validate({"source": {"kind": "label_files", "folder": str(labels)}})
    with pytest.raises(InputError, match="another folder"):
        describe_scene(str(scene), config, str(scene))


@pytest.mark.parametrize("text", ["{", "[]", '{"capture": "a"}'])
def test_damaged_build_record_is_a_warning_and_no_reason_to_refuse_the_scene(scene: Path, text: str) -> None:
    (scene / BUILD).write_text(text)
    report = check_scene(str(scene))
    assert report.usable
    assert report.origin == ""
    assert any("what a build wrote" in line for line in report.warnings)
