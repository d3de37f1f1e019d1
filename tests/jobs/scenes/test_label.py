"""`splatreasoner label`: a scene of one's own gets a scan's ground truth, by the command line."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from jobs.scenes.build import build_scan
from jobs.scenes.label import label_scene
from pipeline.metrics.iou import weighted_iou
from pipeline.scene import Scene, Semantics
from pipeline.scene.load import load_objects, load_scene
from pipeline.scene.save import save_scene
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError
from schemas.question_file import load_questions
from tests.construct.scan import PARTS, write_scan
from tests.jobs.test_cli import one_line, run


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scan(tmp_path_factory.mktemp("scan") / "scan")


@pytest.fixture(scope="module")
def built(scan: Path) -> Scene:
    folder = str(scan.parent / "built")
    build_scan(scan, folder, views=2)
    return load_scene(folder)


@pytest.fixture(scope="module")
def bare(scan: Path, built: Scene) -> str:
    """The scan's Gaussians a little moved, with a floater, and with categories of a detector of its own."""
    rng = np.random.default_rng(0)
    means = built.gaussians.means + rng.normal(0, 0.004, built.gaussians.means.shape).astype(np.float32)
    means[0] = [0, 0, 50]
    seen = Semantics(("thing",), np.zeros(len(means), np.int32))
    folder = str(scan.parent / "bare")
    save_scene(
        dataclasses.replace(built, gaussians=dataclasses.replace(built.gaussians, means=means), semantics=seen), folder
    )
    (Path(folder) / "questions.jsonl").write_bytes((scan.parent / "built" / "questions.jsonl").read_bytes())
    return folder


def test_label_writes_a_scene_with_instances_categories_objects_and_questions(
    scan: Path, bare: str, built: Scene, tmp_path: Path
) -> None:
    found = run("label", bare, "--from", scan, "--output", tmp_path / "new", "--threads", "1")
    assert found.returncode == 0, found.stderr
    assert found.stderr == ""
    assert f"{len(PARTS)} instances" in one_line(found.stdout)
    scene, objects = load_scene(str(tmp_path / "new")), load_objects(str(tmp_path / "new"))
    assert scene.semantics.vocabulary == built.semantics.vocabulary
    assert scene.semantics.instance is not None
    assert built.semantics.instance is not None
    assert scene.semantics.category is not None
    assert (scene.semantics.instance[0], scene.semantics.category[0]) == (-1, -1)
    assert (scene.semantics.instance == built.semantics.instance)[1:].mean() > 0.97
    assert [(o.instance, o.category) for o in objects] == [(n, part[0]) for n, part in enumerate(PARTS)]
    assert load_questions(tmp_path / "new" / "questions.jsonl") == load_questions(Path(bare) / "questions.jsonl")
    assert [view.name for view in scene.views] == [view.name for view in built.views]


def test_kept_categories_stay_and_a_prediction_does_not_pay_for_unlabelled_gaussians(
    scan: Path, bare: str, tmp_path: Path
) -> None:
    label_scene(bare, str(scan), str(tmp_path / "new"), keep_categories=True)
    scene = load_scene(str(tmp_path / "new"))
    assert scene.semantics.vocabulary == ("thing",)
    assert scene.semantics.category is not None
    assert (scene.semantics.category == 0).all()
    assert scene.semantics.instance is not None
    target = np.flatnonzero(scene.semantics.instance == 5)
    weights = SceneContext(scene).weights("percentile")
    assert weights[0] == 0
    assert (weights[scene.semantics.instance >= 0] > 0).all()
    assert weighted_iou(np.append(target, 0), target, weights) == 1.0


def test_too_few_labels_are_told(scan: Path, bare: str, tmp_path: Path) -> None:
    scene = load_scene(bare)
    far = dataclasses.replace(scene.gaussians, means=scene.gaussians.means + np.array([2.5, 0, 0], np.float32))
    save_scene(dataclasses.replace(scene, gaussians=far), str(tmp_path / "far"))
    made = label_scene(str(tmp_path / "far"), str(scan), str(tmp_path / "new"))
    assert 0 < made.near < 0.5
    assert any("same coordinates" in line for line in made.warnings)
    assert any("have no Gaussian" in line for line in made.warnings)


def test_wrong_input_is_one_line_and_exits_2(scan: Path, bare: str, tmp_path: Path) -> None:
    points = tmp_path / "points.npz"
    np.savez(points, points=np.zeros((1, 3)), category=np.zeros(1, int), vocabulary=np.array(["a"]))
    new = str(tmp_path / "new")
    for arguments, message in (
        ((bare, "--from", str(scan), "--output", bare + "/."), "another folder than the scene's"),
        ((bare, "--from", "none", "--output", new), "a folder with one ScanNet scan"),
        (("none", "--from", str(scan), "--output", new), "a scene folder"),
        ((bare, "--from", str(scan), "--output", new, "--reach", "0"), "--reach: expected"),
        ((bare, "--from", str(points), "--output", new, "--keep-categories"), "instance: expected"),
    ):
        found = run("label", *arguments)
        assert found.returncode == 2, found.stdout
        assert message in one_line(found.stderr)
    assert not Path(new).exists()


def test_nothing_is_written_where_no_gaussian_gets_a_label(bare: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "points.npz", points=np.full((1, 3), 1e4), instance=np.zeros(1, int))
    with pytest.raises(InputError, match="other coordinates"):
        label_scene(bare, str(tmp_path / "points.npz"), str(tmp_path / "new"))
    assert not (tmp_path / "new").exists()
