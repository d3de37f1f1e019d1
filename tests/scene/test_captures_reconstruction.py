"""nerfstudio and COLMAP projects as captures: images, depth of its own size, sparse points."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.captures import open_capture, read_colmap_capture, read_nerfstudio_capture
from pipeline.scene.captures.reconstruction import ColmapDepth, ColmapPoints
from schemas.errors import InputError
from tests.scene import box_room


def test_nerfstudio_depth_smaller_than_the_image_has_its_own_lens(tmp_path: Path) -> None:
    frame = read_nerfstudio_capture(str(box_room.write_nerfstudio(tmp_path))).frames[0]
    assert (frame.depth_lens.width, frame.depth_lens.K[0, 0]) == (32, box_room.FOCAL / 2)
    assert frame.camera.width == 64


def test_nerfstudio_without_images_still_has_cameras(tmp_path: Path) -> None:
    folder = box_room.write_nerfstudio(tmp_path)
    for path in [*folder.glob("images/*"), *folder.glob("depth/*")]:
        path.unlink()
    capture = open_capture(str(folder / "transforms.json"))
    assert [(frame.image, frame.depth) for frame in capture.frames] == [(None, None)] * 4
    assert len(capture.cameras) == 4


def test_nerfstudio_depth_unit_is_an_argument(tmp_path: Path) -> None:
    folder = str(box_room.write_nerfstudio(tmp_path))
    one, ten = (read_nerfstudio_capture(folder, depth_unit_m=unit).frames[0].read_depth() for unit in (0.001, 0.01))
    np.testing.assert_allclose(ten, 10 * one, rtol=1e-5)


def test_broken_nerfstudio_pose_is_skipped_and_counted(tmp_path: Path) -> None:
    path = box_room.write_nerfstudio(tmp_path) / "transforms.json"
    path.write_text(path.read_text().replace("1.2", "NaN", 1))
    capture = open_capture(str(tmp_path))
    assert (len(capture), capture.skip_counts) == (3, {"broken pose": 1})


def test_colmap_brings_its_sparse_points(tmp_path: Path) -> None:
    capture = read_colmap_capture(str(box_room.write_colmap(tmp_path / "a")))
    assert capture.points is not None
    points = capture.points.read()
    np.testing.assert_allclose(points.positions, [[0.5, 0, 1.25], [4, 1, 1]])
    assert points.colors.tolist() == [[10, 20, 30], [255, 0, 0]]


def test_binary_points_equal_text_points(tmp_path: Path) -> None:
    data = struct.pack("<Q", 2)
    data += struct.pack("<Q3d3BdQ", 1, 0.5, 0, 1.25, 10, 20, 30, 0.1, 2) + bytes(16)
    data += struct.pack("<Q3d3BdQ", 2, 4, 1, 1, 255, 0, 0, 0.2, 0)
    (tmp_path / "points3D.bin").write_bytes(data)
    points = ColmapPoints(str(tmp_path / "points3D.bin")).read()
    np.testing.assert_allclose(points.positions, [[0.5, 0, 1.25], [4, 1, 1]])
    assert points.colors.tolist() == [[10, 20, 30], [255, 0, 0]]


@pytest.mark.parametrize("data", [b"", b"\xff" * 8, struct.pack("<Q3d3BdQ", 1, 0, 0, 0, 0, 0, 0, 0, 2**63)])
def test_damaged_points_are_an_input_error(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "points3D.bin").write_bytes(data)
    with pytest.raises(InputError, match=r"a whole points3D\.bin"):
        ColmapPoints(str(tmp_path / "points3D.bin")).read()


@pytest.mark.parametrize("line", ["1 2 3", "1 a b c 1 2 3 0", "1 0 0 0 red 0 0 0"])
def test_a_wrong_line_of_points_is_named(tmp_path: Path, line: str) -> None:
    (tmp_path / "points3D.txt").write_text(f"# head\n{line}\n")
    with pytest.raises(InputError, match="line 2"):
        ColmapPoints(str(tmp_path / "points3D.txt")).read()


@pytest.mark.parametrize("data", [b"", b"4&4&1&" + bytes(60), b"4&4&3&" + bytes(192), b"999999&999999&1&"])
def test_a_damaged_dense_depth_map_is_an_input_error(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.bin").write_bytes(data)
    with pytest.raises(InputError, match="width&height&1&"):
        ColmapDepth(str(tmp_path / "a.bin")).read()


def test_a_model_folder_alone_is_a_capture_without_images(tmp_path: Path) -> None:
    folder = box_room.write_colmap(tmp_path / "a")
    capture = open_capture(str(folder / "sparse/0"))
    assert [frame.image for frame in capture.frames] == [None] * 4
    assert capture.points is not None
