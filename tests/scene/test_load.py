"""Scene folders: what is saved loads the same, what is absent is found or named, what is broken is counted."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene import Scene, Semantics
from pipeline.scene.load import load_objects, load_scene
from pipeline.scene.objects import SceneObject
from pipeline.scene.save import save_scene
from schemas.errors import InputError
from schemas.semantics_table import SemanticsTable, write_semantics
from tests.scene.encoders import spz
from tests.scene.making import inria_columns, ply, random_gaussians, small_scene
from tests.scene.test_captures_colmap import write_text

OBJECTS = (
    SceneObject(3, "chair", "red", (1.0, 2.0, 0.5), (0.3, 0.3, 0.5), 0.2, "kitchen", ("open",), 4, "on"),
    SceneObject(4, "table", "", (1.0, 2.0, 0.0), (1.0, 1.0, 0.4)),
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_scene(small_scene(), str(tmp_path / "flat"), OBJECTS)
    return tmp_path / "flat"


def same_scene(a: Scene, b: Scene) -> None:
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(a.gaussians, name), getattr(b.gaussians, name))
    for name in ("category", "embedding", "instance"):
        np.testing.assert_array_equal(getattr(a.semantics, name), getattr(b.semantics, name))
    assert a.semantics.vocabulary == b.semantics.vocabulary
    assert [view.name for view in a.views] == [view.name for view in b.views]
    for one, other in zip(a.views, b.views, strict=True):
        np.testing.assert_allclose(one.camera.world_to_camera, other.camera.world_to_camera, atol=1e-14)
    assert a.name == b.name
    np.testing.assert_allclose(a.up, b.up)


@pytest.mark.parametrize("uri", [str, Path.as_uri], ids=["path", "file uri"])
def test_saved_scene_loads_the_same(folder: Path, uri: Callable[[Path], str]) -> None:
    loaded = load_scene(uri(folder))
    same_scene(loaded, small_scene())
    assert loaded.warnings == ()
    assert load_objects(uri(folder)) == OBJECTS


def test_saved_scene_loads_the_same_from_another_filesystem() -> None:
    save_scene(small_scene("away"), "mock:///scenes/away", OBJECTS)
    same_scene(load_scene("mock:///scenes/away"), small_scene("away"))
    assert load_objects("mock:///scenes/away") == OBJECTS


def test_scene_moved_elsewhere_still_loads(folder: Path, tmp_path: Path) -> None:
    shutil.move(folder, tmp_path / "moved")
    same_scene(load_scene(str(tmp_path / "moved")), small_scene())


def test_parts_are_found_by_name_without_a_scene_file(folder: Path) -> None:
    (folder / "scene.json").unlink()
    (folder / "gaussians.ply").rename(folder / "splat_lod3.ply")
    same_scene(load_scene(str(folder)), small_scene())


def test_named_splat_file_wins_over_others(folder: Path) -> None:
    (folder / "scene.json").write_text('{"gaussians": "other.spz"}')
    (folder / "other.spz").write_bytes(spz(small_scene().gaussians))
    assert load_scene(str(folder)).name == "flat"
    assert load_scene(str(folder)).gaussians.means.tobytes() != small_scene().gaussians.means.tobytes()


def test_two_splat_files_without_a_choice_are_an_input_error(folder: Path) -> None:
    (folder / "scene.json").unlink()
    (folder / "gaussians.ply").rename(folder / "a.ply")
    shutil.copy(folder / "a.ply", folder / "b.ply")
    with pytest.raises(InputError, match=r"gaussians: expected one splat file .* found a\.ply, b\.ply"):
        load_scene(str(folder))


def test_colmap_model_and_its_photographs_are_found(folder: Path) -> None:
    (folder / "scene.json").unlink()
    (folder / "transforms.json").unlink()
    (folder / "sparse" / "0").mkdir(parents=True)
    write_text(folder / "sparse" / "0")
    (folder / "images" / "a").mkdir(parents=True)
    (folder / "images" / "a" / "1.jpg").touch()
    views = load_scene(str(folder)).views
    assert [view.name for view in views] == ["1", "2"]
    assert [view.image for view in views] == [str(folder / "images" / "a" / "1.jpg"), None]


def test_semantics_follow_the_gaussians_that_are_kept(folder: Path) -> None:
    scene = small_scene()
    columns = {name: column.copy() for name, column in inria_columns(scene.gaussians).items()}
    columns["x"][[2, 5]] = np.nan
    (folder / "gaussians.ply").write_bytes(ply(columns))
    loaded = load_scene(str(folder))
    keep = np.setdiff1d(np.arange(40), [2, 5])
    for name in ("category", "embedding", "instance"):
        np.testing.assert_array_equal(getattr(loaded.semantics, name), getattr(scene.semantics, name)[keep])
    assert any("dropped 2 Gaussians: mean not finite" in line for line in loaded.warnings)


def test_semantics_of_another_length_are_an_input_error(folder: Path) -> None:
    write_semantics(SemanticsTable(("a",), category=np.zeros(39, np.int32)), folder / "semantics.parquet")
    with pytest.raises(InputError, match="expected 40 rows, one a Gaussian of the splat file, found 39"):
        load_scene(str(folder))


def test_category_outside_the_vocabulary_names_the_file(folder: Path) -> None:
    write_semantics(SemanticsTable(("a",), category=np.full(40, 5, np.int32)), folder / "semantics.parquet")
    with pytest.raises(InputError, match=r"semantics\.parquet: category: expected ids from -1 to 0, found 5 to 5"):
        load_scene(str(folder))


def test_embeddings_are_brought_to_unit_length_with_a_note_and_zero_rows_stay(folder: Path) -> None:
    rows = np.random.default_rng(0).normal(size=(40, 6)).astype(np.float32) * 9
    rows[3] = 0
    write_semantics(SemanticsTable((), embedding=rows), folder / "semantics.parquet")
    scene = load_scene(str(folder))
    assert scene.semantics.embedding is not None
    norms = np.linalg.norm(scene.semantics.embedding, axis=1)
    assert norms[3] == 0
    np.testing.assert_allclose(np.delete(norms, 3), 1, atol=1e-6)
    assert any("normalised 39 of 40" in line for line in scene.warnings)


def test_embedding_with_nan_is_an_input_error(folder: Path) -> None:
    rows = np.ones((40, 2), np.float16)
    rows[7, 1] = np.nan
    write_semantics(SemanticsTable((), embedding=rows), folder / "semantics.parquet")
    with pytest.raises(InputError, match="1 rows with NaN"):
        load_scene(str(folder))


def test_scene_without_semantics_loads_and_says_so(folder: Path) -> None:
    (folder / "semantics.parquet").unlink()
    scene = load_scene(str(folder))
    assert len(scene.semantics) == 0
    assert any("no semantics.parquet" in line for line in scene.warnings)


def broken_pose(folder: Path, frames: slice) -> None:
    document = json.loads((folder / "transforms.json").read_text())
    for frame in document["frames"][frames]:
        frame["transform_matrix"][0][0] = math.nan
    (folder / "transforms.json").write_text(json.dumps(document))


def test_broken_poses_are_skipped_and_counted(folder: Path) -> None:
    broken_pose(folder, slice(1, 2))
    scene = load_scene(str(folder))
    assert [view.name for view in scene.views] == ["v0", "v2"]
    assert any(line.startswith("skipped 1 of 3 views with an unusable pose") for line in scene.warnings)


def test_no_usable_pose_is_an_input_error(folder: Path) -> None:
    broken_pose(folder, slice(None))
    with pytest.raises(InputError, match="at least one usable view, found none of 3"):
        load_scene(str(folder))


def test_missing_cameras_say_what_was_looked_for(folder: Path) -> None:
    (folder / "scene.json").unlink()
    (folder / "transforms.json").unlink()
    with pytest.raises(InputError, match=r"cameras: expected transforms\.json or a COLMAP model"):
        load_scene(str(folder))


def test_missing_folder_and_a_file_in_its_place_are_input_errors(folder: Path) -> None:
    with pytest.raises(InputError, match="nothing there"):
        load_scene(str(folder / "no"))
    with pytest.raises(InputError, match="scene folder"):
        load_scene(str(folder / "gaussians.ply"))


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("{", ""),
        ("[]", "scene.json"),
        ('{"colour": 1}', "colour"),
        ('{"up": [0, 0, 0]}', "up"),
        ('{"up": [0, 0]}', "up.2"),
        ('{"up": [0, NaN, 1]}', "up"),
        ('{"name": 3}', "name"),
    ],
)
def test_wrong_scene_file_is_named(folder: Path, text: str, field: str) -> None:
    (folder / "scene.json").write_text(text)
    with pytest.raises(InputError) as caught:
        load_scene(str(folder))
    assert (caught.value.subject, caught.value.field) == (str(folder / "scene.json"), field)


def test_up_is_made_a_unit_vector_and_other_units_are_noted(folder: Path) -> None:
    (folder / "scene.json").write_text('{"up": [0, 5, 0], "units": "feet", "name": "hall"}')
    scene = load_scene(str(folder))
    np.testing.assert_allclose(scene.up, [0, 1, 0])
    assert scene.name == "hall"
    assert any("'feet'" in line for line in scene.warnings)


def test_scene_of_splats_alone_saves_without_semantics_or_objects(tmp_path: Path) -> None:
    scene = small_scene()
    bare = Scene("bare", random_gaussians(5, 0), scene.views, Semantics(()))
    save_scene(bare, str(tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["gaussians.ply", "scene.json", "transforms.json"]
    assert load_objects(str(tmp_path)) == ()
    assert load_scene(str(tmp_path)).name == "bare"


def test_scene_saved_over_another_leaves_nothing_of_it(folder: Path) -> None:
    scene = small_scene()
    save_scene(Scene("bare", random_gaussians(5, 0), scene.views, Semantics(())), str(folder))
    assert len(load_scene(str(folder)).semantics) == 0
    assert load_objects(str(folder)) == ()


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"version": 2, "objects": []}',
        '{"version": 1, "objects": {}}',
        '{"version": 1, "objects": [3]}',
        '{"version": 1, "objects": [{"instance": 1}]}',
    ],
)
def test_malformed_objects_are_an_input_error(folder: Path, text: str) -> None:
    (folder / "objects.json").write_text(text)
    with pytest.raises(InputError, match=r"objects\.json"):
        load_objects(str(folder))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("instance", "one"),
        ("instance", 4),
        ("category", 7),
        ("center", [1, 2]),
        ("center", [1, 2, math.nan]),
        ("half_extents", ["a", 1, 1]),
        ("yaw", "left"),
        ("states", "open"),
        ("relation", "near"),
        ("parent", 1.5),
    ],
)
def test_wrong_object_field_is_named(folder: Path, field: str, value: object) -> None:
    document = json.loads((folder / "objects.json").read_text())
    document["objects"][0][field] = value
    (folder / "objects.json").write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        load_objects(str(folder))
    assert caught.value.field == field


def test_real_scene_loads_in_metres_with_all_its_views(shared_data: Path) -> None:
    scene = load_scene(str(shared_data / "showroom"))
    assert (scene.name, len(scene.gaussians), len(scene.views)) == ("showroom", 746_973, 300)
    assert scene.warnings == ("no semantics.parquet: no category can be activated",)
