"""transforms.json: axes, lenses, names, and what happens to frames that cannot be used."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.scene import View
from pipeline.scene.captures import read_nerfstudio, transforms_json
from schemas.errors import InputError
from tests.scene.making import camera

LENS = {"fl_x": 30.0, "fl_y": 31.0, "cx": 15.0, "cy": 11.0, "w": 32, "h": 24}
IDENTITY = np.eye(4).tolist()


def write(folder: Path, document: Any) -> str:
    path = folder / "transforms.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return str(path)


def frame(name: str = "images/a.png", pose: Any = None, **more: Any) -> dict[str, Any]:
    return {"file_path": name, "transform_matrix": IDENTITY if pose is None else pose, **more}


def test_opengl_identity_looks_down_minus_z_with_y_up(tmp_path: Path) -> None:
    view = read_nerfstudio(write(tmp_path, {**LENS, "frames": [frame()]})).views[0]
    np.testing.assert_allclose(view.camera.forward, [0, 0, -1])
    # A point ahead, to the right and above lands right of and above the principal point.
    pixels, depth = view.camera.project(np.array([[0.1, 0.2, -1.0]]))
    assert depth[0] == pytest.approx(1)
    np.testing.assert_allclose(pixels[0], [15 + 30 * 0.1, 11 - 31 * 0.2])


def test_translation_is_the_camera_centre(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    view = read_nerfstudio(write(tmp_path, {**LENS, "frames": [frame(pose=pose.tolist())]})).views[0]
    np.testing.assert_allclose(view.camera.center, [1, 2, 3])


def test_rounded_rotation_leaves_the_centre_where_the_file_says(tmp_path: Path) -> None:
    pose = np.vstack([camera((3.0, 1.0, 1.0)).camera_to_world, [0, 0, 0, 1]]).round(4)
    pose[:3, 3] = 1000, -2000, 30
    view = read_nerfstudio(write(tmp_path, {**LENS, "frames": [frame(pose=pose.tolist())]})).views[0]
    np.testing.assert_allclose(view.camera.center, [1000, -2000, 30], atol=1e-9)


def test_lens_of_a_frame_overrides_that_of_all(tmp_path: Path) -> None:
    frames = [frame("a.png"), frame("b.png", fl_x=60.0, w=64)]
    views = read_nerfstudio(write(tmp_path, {**LENS, "frames": frames})).views
    assert [view.camera.K[0, 0] for view in views] == [30, 60]
    assert [view.camera.width for view in views] == [32, 64]


def test_field_of_view_stands_in_for_focal_lengths(tmp_path: Path) -> None:
    document = {"camera_angle_x": math.pi / 2, "w": 32, "h": 24, "frames": [frame()]}
    K = read_nerfstudio(write(tmp_path, document)).views[0].camera.K
    np.testing.assert_allclose(K, [[16, 0, 16], [0, 16, 12], [0, 0, 1]])


@pytest.mark.parametrize("key", ["k1", "k4", "p2"])
def test_distortion_is_refused_by_name_and_zero_is_not(tmp_path: Path, key: str) -> None:
    read_nerfstudio(write(tmp_path, {**LENS, key: 0.0, "frames": [frame()]}))
    with pytest.raises(InputError, match=f"{key}: expected 0: undistort"):
        read_nerfstudio(write(tmp_path, {**LENS, key: 0.01, "frames": [frame()]}))


def test_fisheye_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="camera_model"):
        read_nerfstudio(write(tmp_path, {**LENS, "camera_model": "OPENCV_FISHEYE", "frames": [frame()]}))


BROKEN_POSES = {
    "nan": [[math.nan, 0, 0, 0], *IDENTITY[1:]],
    "infinite": [[1, 0, 0, math.inf], *IDENTITY[1:]],
    "scaled": (np.eye(4) * 2).tolist(),
    "mirrored": np.diag([1.0, 1.0, -1.0, 1.0]).tolist(),
}


@pytest.mark.parametrize("kind", BROKEN_POSES)
def test_broken_pose_is_one_line_that_names_file_and_frame(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, {**LENS, "frames": [frame("good.png"), frame("bad.png", BROKEN_POSES[kind])]})
    with pytest.raises(InputError) as caught:
        read_nerfstudio(path)
    assert str(caught.value).startswith(f"{path} frame 1 (bad): pose: expected")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", BROKEN_POSES)
def test_broken_poses_are_skipped_and_counted_when_not_strict(tmp_path: Path, kind: str) -> None:
    frames = [frame("good.png"), frame("bad.png", BROKEN_POSES[kind])]
    found = read_nerfstudio(write(tmp_path, {**LENS, "frames": frames}), strict=False)
    assert [view.name for view in found.views] == ["good"]
    assert found.warnings[0].startswith("skipped 1 of 2 views")


def test_no_usable_pose_is_an_error_even_when_not_strict(tmp_path: Path) -> None:
    path = write(tmp_path, {**LENS, "frames": [frame(pose=BROKEN_POSES["nan"])]})
    with pytest.raises(InputError, match="at least one usable view"):
        read_nerfstudio(path, strict=False)


@pytest.mark.parametrize(
    "document",
    [
        "{",
        "[]",
        "{}",
        {"frames": []},
        {"frames": [3]},
        {"frames": [frame()]},
        {**LENS, "frames": [{"file_path": "a.png"}]},
        {**LENS, "frames": [{"transform_matrix": IDENTITY}]},
        {**LENS, "frames": [frame(pose=[[1, 2], [3, 4]])]},
        {**LENS, "frames": [frame(pose=[[1, 2, 3, "x"]] * 3)]},
        {**LENS, "frames": [frame(pose=[[1], [1, 2]])]},
        {**LENS, "fl_x": "wide", "frames": [frame()]},
        {**LENS, "fl_x": -3, "frames": [frame()]},
        {**LENS, "w": 0, "frames": [frame()]},
        {**LENS, "w": 32.5, "frames": [frame()]},
        {**LENS, "fl_x": math.nan, "frames": [frame()]},
    ],
)
def test_malformed_file_is_an_input_error(tmp_path: Path, document: Any) -> None:
    with pytest.raises(InputError):
        read_nerfstudio(write(tmp_path, document), strict=False)


def test_names_are_stems_and_stay_distinct_where_stems_repeat(tmp_path: Path) -> None:
    frames = [frame("./left/0.png"), frame("right/0.png"), frame("right/1.png"), frame("right/1.png")]
    views = read_nerfstudio(write(tmp_path, {**LENS, "frames": frames})).views
    assert [view.name for view in views] == ["left_0", "right_0", "right_1", "right_1#2"]


def test_photographs_are_found_beside_the_file_and_absent_ones_are_none(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for name in ("a.png", "b.jpg", "d.png"):
        (tmp_path / "images" / name).touch()
    frames = [frame("./images/a.png"), frame("images/b"), frame("images/c.png")]
    frames.append(frame(str(tmp_path / "images" / "d.png"), depth_file_path="images/a.png"))
    views = read_nerfstudio(write(tmp_path, {**LENS, "frames": frames})).views
    images = tmp_path / "images"
    assert [view.image for view in views] == [str(images / "a.png"), str(images / "b.jpg"), None, str(images / "d.png")]
    assert [view.depth for view in views] == [None, None, None, str(images / "a.png")]


def test_written_views_read_the_same(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "x 1.png").touch()
    lens = camera().resized(64, 48)
    views = (
        View("first", camera((3.0, 1.0, 1.0)), image=str(tmp_path / "photos" / "x 1.png")),
        View("second", lens.moved_to(camera((0.0, 2.0, 2.0)).world_to_camera)),
    )
    (tmp_path / "transforms.json").write_bytes(transforms_json(views, str(tmp_path)))
    read = read_nerfstudio(str(tmp_path / "transforms.json")).views
    assert [view.name for view in read] == ["first", "second"]
    assert [view.image for view in read] == [views[0].image, None]
    for a, b in zip(read, views, strict=True):
        np.testing.assert_array_equal(a.camera.K, b.camera.K)
        np.testing.assert_allclose(a.camera.world_to_camera, b.camera.world_to_camera, atol=1e-14)
        assert (a.camera.width, a.camera.height) == (b.camera.width, b.camera.height)


def test_written_images_below_the_folder_are_relative_so_that_it_can_move(tmp_path: Path) -> None:
    inside, outside = tmp_path / "scene" / "a.png", tmp_path / "b.png"
    views = (View("a", camera(), image=str(inside)), View("b", camera(), image=str(outside)))
    document = json.loads(transforms_json(views, str(tmp_path / "scene")))
    assert [entry["file_path"] for entry in document["frames"]] == ["a.png", str(outside)]


def test_real_capture_reads_upright_in_opencv_axes(shared_data: Path) -> None:
    found = read_nerfstudio(str(shared_data / "showroom" / "transforms.json"))
    assert len(found.views) == 300
    ups = np.stack([-view.camera.world_to_camera[1, :3] for view in found.views])
    assert ups[:, 2].min() > 0.5
    np.testing.assert_allclose(found.views[0].camera.center, [-0.899789, -14.848015, 0.848394])
