"""check_scene: counts, what is missing, what looks wrong, and errors gathered instead of raised."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene import Scene, View
from pipeline.scene.check import check_scene
from pipeline.scene.formats import save_gaussians
from pipeline.scene.gaussians import Gaussians
from pipeline.scene.objects import SceneObject
from pipeline.scene.save import save_scene
from tests.scene.making import camera, inria_columns, ply, small_scene


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_scene(small_scene(), str(tmp_path / "flat"), [SceneObject(3, "chair", "", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))])
    return tmp_path / "flat"


def scaled(gaussians: Gaussians, factor: float) -> Gaussians:
    means = (gaussians.means * factor).astype(np.float32)
    return Gaussians(means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, gaussians.sh)


def test_sound_scene_is_usable_and_counted(folder: Path) -> None:
    scene, report = small_scene(), check_scene(str(folder))
    assert report.usable
    assert report.errors == report.warnings == ()
    assert (report.name, report.format, report.gaussians, report.sh_degree) == ("flat", "ply", 40, 1)
    assert (report.views, report.skipped_views, report.photographs) == (3, 0, 0)
    assert (report.categories, report.embedding_size, report.instances, report.objects) == (2, 8, 4, 1)
    assert scene.semantics.category is not None
    assert report.labelled == pytest.approx((scene.semantics.category >= 0).mean())
    assert report.image_sizes == ((32, 24),)
    low, high = np.array(report.bounds)
    np.testing.assert_allclose(low, np.percentile(scene.gaussians.means.astype(float), 1, axis=0))
    assert (low < high).all()
    opacity = 1 / (1 + np.exp(-scene.gaussians.opacity_logits.astype(float)))
    assert report.opacity[1] == pytest.approx(np.median(opacity), abs=1e-6)
    assert report.scale[1] == pytest.approx(np.median(np.exp(scene.gaussians.log_scales.max(axis=1))), rel=1e-5)


def test_lines_tell_the_report_one_fact_a_line(folder: Path) -> None:
    lines = check_scene(str(folder)).lines()
    assert lines[0] == f"scene flat: usable ({folder})"
    assert any(line.startswith("gaussians: 40 (ply, SH degree 1)") for line in lines)
    assert any("2 categories" in line for line in lines)
    assert any(line.startswith("missing: photographs") for line in lines)
    assert not any("\n" in line for line in lines)


def test_every_error_is_gathered_not_only_the_first(folder: Path) -> None:
    (folder / "gaussians.ply").write_bytes(b"ply\n")
    (folder / "transforms.json").write_text("{")
    (folder / "objects.json").write_text("[]")
    report = check_scene(str(folder))
    assert not report.usable
    assert len(report.errors) == 3
    assert all(name in line for name, line in zip(["gaussians", "transforms", "objects"], report.errors, strict=True))
    assert report.lines()[0].startswith("scene flat: NOT USABLE")


def test_missing_folder_is_one_error(tmp_path: Path) -> None:
    report = check_scene(str(tmp_path / "no"))
    assert not report.usable
    assert len(report.errors) == 1
    assert report.lines()


def test_wrong_semantics_make_the_scene_unusable(folder: Path) -> None:
    (folder / "semantics.parquet").write_bytes(b"PAR1")
    report = check_scene(str(folder))
    assert "undamaged Parquet" in report.errors[0]


def test_absent_parts_are_missing_but_the_scene_is_usable(folder: Path) -> None:
    (folder / "semantics.parquet").unlink()
    (folder / "objects.json").unlink()
    report = check_scene(str(folder))
    assert report.usable
    missing = " ".join(report.missing)
    assert all(name in missing for name in ("semantics.parquet", "objects.json", "photographs", "questions.jsonl"))


def test_dropped_gaussians_and_skipped_views_are_counted(folder: Path) -> None:
    columns = {name: column.copy() for name, column in inria_columns(small_scene().gaussians).items()}
    columns["y"][:3] = np.inf
    (folder / "gaussians.ply").write_bytes(ply(columns))
    document = json.loads((folder / "transforms.json").read_text())
    document["frames"][0]["transform_matrix"][2][3] = float("inf")
    (folder / "transforms.json").write_text(json.dumps(document))
    report = check_scene(str(folder))
    assert report.dropped == {"mean not finite": 3}
    assert (report.views, report.skipped_views) == (2, 1)
    assert report.usable
    assert len(report.warnings) == 2


@pytest.mark.parametrize("factor", [1000.0, 0.01])
def test_size_no_scene_in_metres_has_is_warned_of(folder: Path, factor: float) -> None:
    save_gaussians(scaled(small_scene().gaussians, factor), str(folder / "gaussians.ply"))
    assert any("really metres" in line for line in check_scene(str(folder)).warnings)


def test_size_of_a_scene_in_other_units_is_not_judged(folder: Path) -> None:
    save_gaussians(scaled(small_scene().gaussians, 1000), str(folder / "gaussians.ply"))
    (folder / "scene.json").write_text('{"units": "millimetres"}')
    warnings = check_scene(str(folder)).warnings
    assert not any("really metres" in line for line in warnings)
    assert any("'millimetres'" in line for line in warnings)


def test_cameras_that_disagree_with_up_are_warned_of(folder: Path) -> None:
    (folder / "scene.json").write_text('{"up": [0, 0, -1]}')
    assert any("disagree with the scene's up" in line for line in check_scene(str(folder)).warnings)


def test_cameras_far_from_the_gaussians_are_warned_of(tmp_path: Path) -> None:
    scene = small_scene()
    far = (*scene.views[1:], View("far", camera((500.0, 0.0, 0.0))))
    save_scene(Scene("far", scene.gaussians, far, scene.semantics), str(tmp_path))
    assert any("1 of 3 cameras are far outside" in line for line in check_scene(str(tmp_path)).warnings)


def test_objects_without_gaussians_are_warned_of(tmp_path: Path) -> None:
    save_scene(small_scene(), str(tmp_path), [SceneObject(77, "chair", "", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))])
    assert any("no Gaussian of their instance, such as 77" in line for line in check_scene(str(tmp_path)).warnings)


def test_real_scene_is_usable_and_as_large_as_an_apartment(shared_data: Path) -> None:
    report = check_scene(str(shared_data / "showroom"))
    assert report.usable
    assert report.warnings == ()
    size = np.subtract(*np.array(report.bounds)[::-1])
    assert (size > (15, 20, 2)).all()
    assert (size < (25, 30, 6)).all()
