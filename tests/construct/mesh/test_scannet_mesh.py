"""A whole scan to a scene: a synthetic one with known truth, wrong files, and the real one where it is at hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.mesh.scannet_mesh import ScannetScene, build_scannet_mesh
from pipeline.render import prepare, render
from pipeline.scene.questions import generate_questions
from schemas.errors import InputError
from tests.construct.scan import NAME, PARTS, YAW, build_arrays, write_scan

VIEWS = 24


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scan(tmp_path_factory.mktemp("scan"))


@pytest.fixture(scope="module")
def built(folder: Path) -> ScannetScene:
    return build_scannet_mesh(folder, views=VIEWS, width=80, height=60)


def test_scene_has_one_gaussian_a_vertex_with_its_labels(built: ScannetScene) -> None:
    vertices, _, _, parts = build_arrays()
    scene = built.scene
    assert scene.name == NAME
    assert len(scene.gaussians) == len(vertices)
    assert scene.semantics.vocabulary == tuple(sorted({part[0] for part in PARTS}))
    assert scene.semantics.category is not None
    np.testing.assert_array_equal(scene.semantics.instance, parts)
    names = [scene.semantics.vocabulary[i] for i in scene.semantics.category]
    assert names == [PARTS[p][0] for p in parts]


def test_objects_have_aligned_boxes_colors_and_support(built: ScannetScene) -> None:
    by_id = {o.instance: o for o in built.objects}
    assert set(by_id) == set(range(len(PARTS)))
    for number, (category, low, high, _) in enumerate(PARTS):
        o = by_id[number]
        size = np.array(high) - low
        turned = np.round((o.yaw - YAW) / (np.pi / 2)) % 2 == 1
        expected = size[[1, 0, 2]] if turned else size
        np.testing.assert_allclose(2 * np.array(o.half_extents), expected, atol=0.02, err_msg=category)
        middle = (np.array(low) + high) / 2
        cos, sin = np.cos(YAW), np.sin(YAW)
        there = np.array([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1], middle[2]])
        np.testing.assert_allclose(o.center, there, atol=0.02, err_msg=category)
    assert {(o.category, o.color) for o in built.objects} >= {("box", "red"), ("ball", "blue"), ("table", "brown")}
    stated = {(o.category, o.relation, by_id[o.parent].category) for o in built.objects if o.parent >= 0}
    assert stated == {("box", "on", "table"), ("ball", "under", "table")}


def test_views_are_upright_in_free_space_and_look_into_the_room(built: ScannetScene) -> None:
    scene = built.scene
    assert len(scene.views) == VIEWS
    assert len({v.name for v in scene.views}) == VIEWS
    cos, sin = np.cos(YAW), np.sin(YAW)
    prepared = prepare(scene.gaussians)
    covered = []
    for view in scene.views:
        x, y, z = view.camera.center
        local = np.array([cos * x + sin * y, -sin * x + cos * y])
        assert ((local > 0.2) & (local < [3.8, 2.8])).all()
        assert 1.3 < z < 1.7
        assert abs(view.camera.world_to_camera[0, 2]) < 1e-9, "the camera is not level"
        for _, low, high, _ in PARTS[5:]:
            away = np.maximum(np.maximum(np.array(low[:2]) - local, local - high[:2]), 0)
            assert np.hypot(*away) > 0.15
        rendering = render(prepared, view.camera, ("alpha", "depth"))
        assert rendering.alpha is not None
        covered.append(float((rendering.alpha > 0.8).mean()))
    assert np.median(covered) > 0.8


def test_build_is_deterministic_by_seed(folder: Path, built: ScannetScene) -> None:
    again = build_scannet_mesh(folder, views=VIEWS, width=80, height=60)
    other = build_scannet_mesh(folder, views=VIEWS, width=80, height=60, seed=1)

    def centers(scan: ScannetScene) -> np.ndarray:
        return np.stack([view.camera.center for view in scan.scene.views])

    np.testing.assert_array_equal(centers(again), centers(built))
    assert again.objects == built.objects
    assert not np.array_equal(centers(other), centers(built))


def test_density_sets_the_number_of_gaussians(folder: Path) -> None:
    scene, _ = build_scannet_mesh(folder, views=1, density=300.0)
    area = 12 + 2 * 4 * 2.4 + 2 * 3 * 2.4 + 2.9 + 0.7 + 0.9 + 5.4
    assert len(scene.gaussians) == pytest.approx(300 * area, rel=0.05)
    assert scene.semantics.instance is not None
    assert set(scene.semantics.instance.tolist()) == set(range(len(PARTS)))


def test_axis_alignment_sets_the_yaw_of_the_boxes(folder: Path, tmp_path: Path) -> None:
    scan = write_scan(tmp_path / "aligned")
    cos, sin = np.cos(-YAW), np.sin(-YAW)
    (scan / f"{NAME}.txt").write_text(f"axisAlignment = {cos} {-sin} 0 0 {sin} {cos} 0 0 0 0 1 0 0 0 0 1\n")
    _, objects = build_scannet_mesh(scan, views=1)
    assert objects[0].yaw == pytest.approx(YAW)


@pytest.mark.parametrize(
    "ending",
    ["_vh_clean_2.ply", "_vh_clean_2.0.010000.segs.json", ".aggregation.json", ".txt"],
)
def test_a_missing_file_is_named(tmp_path: Path, ending: str) -> None:
    scan = write_scan(tmp_path)
    (scan / f"{NAME}{ending}").unlink()
    with pytest.raises(InputError) as caught:
        build_scannet_mesh(scan)
    assert ending.lstrip("_") in str(caught.value)


def test_labels_of_another_mesh_are_refused(tmp_path: Path) -> None:
    scan = write_scan(tmp_path)
    segments = scan / f"{NAME}_vh_clean_2.0.010000.segs.json"
    record = json.loads(segments.read_text())
    segments.write_text(json.dumps({**record, "segIndices": record["segIndices"][:-1]}))
    with pytest.raises(InputError, match="one a mesh vertex"):
        build_scannet_mesh(scan)


def test_no_folder_and_no_views_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        build_scannet_mesh(tmp_path / "none")
    with pytest.raises(InputError, match="views"):
        build_scannet_mesh(folder, views=0)


@pytest.fixture(scope="module")
def real() -> ScannetScene:
    from tests.conftest import SHARED

    scan = SHARED / "scannet_scene0000_00"
    if not scan.is_dir():
        pytest.skip(f"no ScanNet scan at {scan}")
    return build_scannet_mesh(scan, views=40, width=160, height=120)


def test_real_scan_gives_all_instances_and_views_that_see_the_room(real: ScannetScene) -> None:
    assert len(real.scene.gaussians) == 81_369
    assert len(real.objects) == 55
    prepared, seen = prepare(real.scene.gaussians), set()
    instance = real.scene.semantics.instance
    assert instance is not None
    open_share = []
    for view in real.scene.views:
        rendering = render(prepared, view.camera, ("alpha", "dominant"))
        assert rendering.dominant is not None
        assert rendering.alpha is not None
        ids, counts = np.unique(instance[rendering.dominant[rendering.dominant >= 0]], return_counts=True)
        seen |= set(ids[counts > 20].tolist())
        lower = rendering.alpha[60:]
        open_share.append(float((lower < 0.5).mean()))
    # The scan has no ceiling and a few holes in its floor, so only the lower half must be closed.
    assert np.mean(open_share) < 0.08
    assert len(seen & {o.instance for o in real.objects}) >= 50


def test_real_scan_has_forty_single_target_and_some_multi_target_queries(real: ScannetScene) -> None:
    questions = generate_questions(
        real.scene.name, real.objects, (), np.random.default_rng(0), per_category=4, single=40, multi=6, referring=10
    )
    counts = {c: sum(q.category == c for q in questions) for c in ("single-target", "multi-target", "referring")}
    assert counts == {"single-target": 40, "multi-target": 6, "referring": 10}
    names = {o.instance: o.category for o in real.objects}
    for q in questions:
        if q.category in ("single-target", "referring"):
            (target,) = q.target_ids or ()
            assert names[target] == q.target_category
