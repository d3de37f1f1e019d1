"""A generated apartment as a capture on disk, and the scene that is built from it."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from jobs.builds.build_job import load_build_job
from jobs.tables.table_file import load_table
from pipeline.construct.build_capture import build_capture
from pipeline.construct.build_config import BuildConfig
from pipeline.construct.semantics.labels_2d.label_files import LabelFilesConfig
from pipeline.render import prepare, render
from pipeline.scene.captures import open_capture
from pipeline.scene.load import load_objects, load_scene
from pipeline.scene.procedural import build_apartment
from pipeline.scene.save import save_scene
from schemas.errors import InputError

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
VIEWS = 12


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("captured_apartments", EXAMPLES / "captured_apartments.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def captured(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scene `true` and its capture `captures/apartment-3`, made as a user would."""
    folder = tmp_path_factory.mktemp("captured")
    made = build_apartment(3, rooms=1, gaussians=9_000, views=VIEWS, width=96, height=72)
    save_scene(made.scene, str(folder / "true"), made.objects)
    (folder / "true/questions.jsonl").write_text('{"scene": "apartment-3"}\n')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["", str(folder / "true"), "--output", str(folder / "captures"), "--threads", "1"])
        example.main()
    return folder


def test_capture_has_the_views_of_the_scene_with_depth_and_points_near_the_truth(captured: Path) -> None:
    truth, capture = load_scene(str(captured / "true")), open_capture(str(captured / "captures/apartment-3"))
    assert [frame.name for frame in capture.frames] == [view.name for view in truth.views]
    assert not capture.warnings
    prepared, shares = prepare(truth.gaussians), []
    for frame, view in zip(capture.frames, truth.views, strict=True):
        np.testing.assert_allclose(frame.camera.world_to_camera, view.camera.world_to_camera, atol=1e-9)
        true, depth = render(prepared, view.camera, ("depth",)).depth, frame.read_depth()
        assert true is not None
        measured = depth > 0
        shares.append(measured.mean())
        assert 0 < np.median(np.abs(depth - true)[measured]) < 0.02
    assert 0.5 < np.mean(shares) < 1.0
    assert capture.points is not None
    points = capture.points.read()
    low, high = truth.gaussians.means.min(axis=0) - 0.5, truth.gaussians.means.max(axis=0) + 0.5
    inside = ((points.positions > low) & (points.positions < high)).all(axis=1)
    assert len(inside) > 50
    assert inside.mean() > 0.98


def test_scene_built_of_it_has_its_categories_and_instances(captured: Path, tmp_path: Path) -> None:
    capture = captured / "captures/apartment-3"
    source = load_build_job(EXAMPLES / "build-depth-loss.yaml").build.semantics.source
    assert isinstance(source, LabelFilesConfig)
    source = source.model_copy(update={"folder": str(capture / "labels")})
    settings = {"start": "depth", "train": {"steps": 0}, "semantics": {"source": source}, "register_photos": "off"}
    build_capture(str(capture), BuildConfig.model_validate(settings), str(tmp_path / "built"))
    truth, built = load_scene(str(captured / "true")), load_scene(str(tmp_path / "built"))
    meanings = []
    for scene in (truth, built):
        found = scene.semantics
        assert found.category is not None
        assert found.instance is not None
        known = found.instance >= 0
        pairs = zip(found.instance[known].tolist(), found.category[known].tolist(), strict=True)
        meanings.append({(instance, found.vocabulary[category]) for instance, category in pairs})
        assert known.mean() > 0.8
    assert meanings[1] <= meanings[0]
    assert len(meanings[1]) > 0.5 * len(meanings[0])
    assert load_objects(str(tmp_path / "built")) == load_objects(str(captured / "true"))
    assert built.up == pytest.approx(truth.up, abs=0.05)


def test_scene_without_instances_is_refused(example: ModuleType, captured: Path, tmp_path: Path) -> None:
    scene = load_scene(str(captured / "true"))
    plain = dataclasses.replace(scene, semantics=dataclasses.replace(scene.semantics, instance=None))
    with pytest.raises(InputError, match="instances"):
        example.capture_scene(plain, tmp_path, np.random.default_rng(0))


def test_the_two_builds_differ_in_the_depth_loss_alone_and_make_the_scenes_of_the_table() -> None:
    with_it, without = (load_build_job(EXAMPLES / f"build-{name}.yaml") for name in ("depth-loss", "no-depth-loss"))
    assert with_it.build.train.depth_first > 0
    assert without.build.train.depth_first == 0
    same = with_it.build.train.model_copy(update={"depth_first": 0.0})
    assert with_it.build.model_copy(update={"train": same}) == without.build
    assert (with_it.captures, with_it.questions) == (without.captures, without.questions)
    table = load_table("depth-loss")
    scenes = {run.row: table.job(run).scenes for run in table.runs()}
    for row, job in (("with", with_it), ("without", without)):
        assert [str(Path(job.scene_folder("*")))] == [str(Path(one)) for one in scenes[row]]
