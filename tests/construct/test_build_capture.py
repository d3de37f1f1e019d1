"""A capture of a box room becomes a scene folder; what is built twice, or in two goes, is the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.construct.build_capture import BuildProgress, _train_settings, build_capture
from pipeline.construct.build_config import BuildConfig
from pipeline.scene.captures import open_capture
from pipeline.scene.check import check_scene
from pipeline.scene.load import load_objects, load_scene
from pipeline.scene.objects import SceneObject
from pipeline.scene.objects_file import objects_json
from schemas.builds import BUILDS
from schemas.errors import InputError, StoppedError
from schemas.question_file import load_questions
from tests.scene.box_room import HIGH, write_colmap, write_seven_scenes
from tests.workers.fake_steps import unit

FUSED = BuildConfig.model_validate({"hold_out": 4, "fusion": {"voxel_m": 0.05}, "train": {"steps": 0}})


def trained(steps: int) -> BuildConfig:
    return FUSED.model_copy(update={"train": FUSED.train.model_copy(update={"steps": steps, "checkpoint_steps": 2})})


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seven_scenes(tmp_path_factory.mktemp("captures") / "room")


def test_fused_room_is_a_whole_scene_whose_row_says_what_it_is(room: Path, tmp_path: Path) -> None:
    told: list[BuildProgress] = []
    questions = unit(0, ["Where?"], "room").questions
    record = build_capture(str(room), FUSED, str(tmp_path / "room"), questions=questions, progress=told.append)
    row, scene, report = record.row, load_scene(str(tmp_path / "room")), check_scene(str(tmp_path / "room"))
    assert report.usable
    assert report.origin.startswith(f"{room}, 3 frames fitted, 0 steps")
    assert (row.scene, row.status, row.start, row.frames, row.fitted, row.held_out) == (
        "room",
        "built",
        "depth",
        4,
        3,
        1,
    )
    assert row.started == row.gaussians == len(scene.gaussians) > 100
    assert len(scene.views) == 4
    assert all(view.image is not None for view in scene.views)
    walls = np.minimum(np.abs(scene.gaussians.means), np.abs(HIGH - scene.gaussians.means)).min(axis=1)
    assert np.median(walls) < 0.02
    # The one held-out camera looks elsewhere, so what it sees is told and nothing more is asked of it.
    assert row.psnr is not None
    assert row.depth_error_m is not None
    assert any("no categories" in line for line in row.warnings)
    assert any("which way is up" in line for line in row.warnings)
    assert load_questions(tmp_path / "room" / "questions.jsonl") == questions
    assert BUILDS.to_rows(BUILDS.to_arrow([row])) == [row]
    assert [one.stage for one in told if one.share == 0.0][:3] == ["open", "select", "fuse"]
    assert set(record.seconds) == {"open", "select", "fuse", "photos", "measure", "describe", "save"}


def test_capture_gives_the_same_gaussians_whatever_the_threads(room: Path, tmp_path: Path) -> None:
    files = []
    for threads in (1, 2):
        build_capture(str(room), FUSED, str(tmp_path / str(threads)), threads=threads)
        files.append((tmp_path / str(threads) / "gaussians.ply").read_bytes())
    assert files[0] == files[1]


def test_optimisation_that_was_stopped_goes_on_to_the_same_bits(room: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    config = trained(6)
    whole = build_capture(str(room), config, str(tmp_path / "whole"))
    assert whole.row.steps == 6
    steps: list[float] = []

    def stop() -> bool:
        steps.append(0.0)
        return bool(list((tmp_path / "working").iterdir()))

    (tmp_path / "working").mkdir()
    with pytest.raises(StoppedError):
        build_capture(str(room), config, str(tmp_path / "parts"), checkpoint=tmp_path / "working", stop=stop)
    assert not (tmp_path / "parts" / "scene.json").exists()
    build_capture(str(room), config, str(tmp_path / "parts"), checkpoint=tmp_path / "working")
    assert (tmp_path / "parts" / "gaussians.ply").read_bytes() == (tmp_path / "whole" / "gaussians.ply").read_bytes()


def test_build_that_is_stopped_before_it_has_anything_leaves_no_scene(room: Path, tmp_path: Path) -> None:
    with pytest.raises(StoppedError, match="stage open"):
        build_capture(str(room), FUSED, str(tmp_path / "room"), stop=lambda: True)
    assert not (tmp_path / "room").exists()


def test_moved_photographs_are_the_recorded_views_and_the_row_says_so(room: Path, tmp_path: Path) -> None:
    config = FUSED.model_copy(update={"register_photos": "on"})
    row = build_capture(str(room), config, str(tmp_path / "room")).row
    recorded = {frame.name: frame.camera.world_to_camera for frame in open_capture(str(room)).frames}
    views = {view.name: view.camera.world_to_camera for view in load_scene(str(tmp_path / "room")).views}
    moved = [name for name, pose in views.items() if not np.allclose(pose, recorded[name], atol=1e-9)]
    assert list(views) == list(recorded)
    assert 0 < row.photos_moved <= row.fitted == 3
    assert 0 < len(moved) <= row.photos_moved
    assert any(line.startswith(f"moved {row.photos_moved} of 3 photographs") for line in row.warnings)


def test_poses_that_were_refined_are_the_recorded_views(room: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    train = {**trained(3).train.model_dump(), "refine_poses": True}
    config = BuildConfig.model_validate({**FUSED.model_dump(), "train": train, "register_photos": "off"})
    build_capture(str(room), config, str(tmp_path / "room"))
    recorded = [frame.camera.world_to_camera for frame in open_capture(str(room)).frames]
    views = [view.camera.world_to_camera for view in load_scene(str(tmp_path / "room")).views]
    same = [np.allclose(a, b, atol=1e-9) for a, b in zip(recorded, views, strict=True)]
    assert same == [False, False, False, True], "the last of four was held out"


def test_label_images_name_the_gaussians_they_cover(room: Path, tmp_path: Path) -> None:
    (tmp_path / "names.json").write_text(json.dumps(["wall", "door"]))
    for number in range(4):
        Image.fromarray(np.ones((36, 64), np.uint8)).save(tmp_path / f"frame-{number:06d}.label.png")
    doors = [SceneObject(k, "door", "white", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)) for k in (1, 2)]
    (tmp_path / "objects.json").write_bytes(objects_json(doors))
    source = {"kind": "label_files", "folder": str(tmp_path), "instance": "{frame}.label.png"}
    semantics = {"semantics": {"source": {**source, "objects": "objects.json"}}}
    config = BuildConfig.model_validate({**FUSED.model_dump(), **semantics})
    row = build_capture(str(room), config, str(tmp_path / "room")).row
    scene = load_scene(str(tmp_path / "room"))
    assert scene.semantics.present() == ("door",)
    assert scene.semantics.instance is not None
    assert set(scene.semantics.instance.tolist()) <= {-1, 1}
    assert load_objects(str(tmp_path / "room")) == tuple(doors)
    assert (row.labels, row.categories, row.objects) == ("label_files", 1, 2)
    assert row.labelled > 0.5
    assert any("1 of 2 ground-truth objects have no Gaussian" in line for line in row.warnings)


def test_sparse_points_start_a_capture_without_depth(tmp_path: Path) -> None:
    capture = write_colmap(tmp_path / "project")
    for depth in (*capture.glob("depth/*"), *capture.glob("stereo/**/*.bin")):
        depth.unlink()
    (points,) = capture.rglob("points3D.txt")
    corners = [(x, y, z) for x in (2.0, 3.0, 3.9) for y in (1.0, 2.0) for z in (0.8, 1.2)]
    points.write_text("".join(f"{n} {x} {y} {z} 9 9 9 0.1\n" for n, (x, y, z) in enumerate(corners)))
    config = FUSED.model_copy(update={"hold_out": None})
    row = build_capture(str(capture), config, str(tmp_path / "room")).row
    assert (row.start, row.held_out, row.psnr) == ("points", 0, None)
    assert 4 <= row.gaussians <= len(corners)


@pytest.mark.parametrize(("source", "asked", "every"), [("points", 0, 50), ("points", 7, 7), ("depth", 0, 0)])
def test_sparse_points_alone_are_densified_where_the_settings_do_not_say(source: str, asked: int, every: int) -> None:
    config = BuildConfig.model_validate({"train": {"density": {"every": asked}}})
    settings = _train_settings(config, source, threads=3)
    assert (settings.density.every, settings.threads) == (every, 3)


def test_capture_without_sparse_points_cannot_start_from_them(room: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="start: expected sparse points, found none"):
        build_capture(str(room), FUSED.model_copy(update={"start": "points"}), str(tmp_path / "room"))


def test_chosen_frames_alone_are_fitted_and_recorded(room: Path, tmp_path: Path) -> None:
    config = FUSED.model_copy(update={"frames": 2, "hold_out": None})
    row = build_capture(str(room), config, str(tmp_path / "room")).row
    assert (row.frames, row.fitted) == (4, 2)
    assert len(load_scene(str(tmp_path / "room")).views) == 2
