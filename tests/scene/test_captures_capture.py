"""Captures, frames and image files: sizes, blank depth, formats of depth, names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.captures import Capture, Frame, read_frame_folder, read_sens
from pipeline.scene.captures.image_files import DepthFile, ImageFile, depth_in_metres
from schemas.errors import InputError
from tests.scene import box_room


def capture(tmp_path: Path) -> Capture:
    return read_frame_folder(str(box_room.write_scannet(tmp_path / "scannet")))


def test_frames_are_read_when_asked_for_and_not_before(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    (folder / "000002-rgb.png").write_bytes(b"no image")
    frames = read_frame_folder(str(folder)).frames
    assert frames[1].read_image().shape == (36, 64, 3)
    with pytest.raises(InputError, match=r"000002-rgb\.png"):
        frames[2].read_image()


def test_an_image_of_another_size_than_the_camera_is_refused(tmp_path: Path) -> None:
    made = capture(tmp_path)
    box_room.save_image(tmp_path / "scannet/000003-rgb.png", np.zeros((18, 32, 3), np.uint8))
    with pytest.raises(InputError, match=r"000003-rgb.png: image: expected 64 x 36 pixels.* found 32 x 18"):
        made.frames[3].read_image()


def test_blank_depth_is_left_out_and_counted(tmp_path: Path) -> None:
    made = capture(tmp_path)
    blank = np.zeros((18, 32), np.uint16)
    blank[0, :5] = 900
    box_room.save_image(tmp_path / "scannet/000001-depth.png", blank)
    seen: list[int] = []
    left = made.without_empty_depth(progress=seen.append)
    assert [frame.name for frame in left.frames] == ["000000", "000002", "000003"]
    assert left.skip_counts == {"empty depth": 1}
    assert "0.9% of its pixels" in left.warnings[0]
    assert seen == [1, 2, 3, 4]
    assert len(made.without_empty_depth(0.001)) == 4


def test_only_keeps_capture_order_and_the_record_of_skips(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    (folder / "000000.txt").unlink()
    some = read_frame_folder(str(folder)).only(["000003", "000001"])
    assert [frame.name for frame in some.frames] == ["000001", "000003"]
    assert some.skip_counts == {"no pose": 1}


def test_views_carry_names_cameras_and_paths(tmp_path: Path) -> None:
    view = capture(tmp_path).views[1]
    assert view.name == "000001"
    assert view.camera.width == 64
    assert view.image == str(tmp_path / "scannet/000001-rgb.png")
    assert view.depth == str(tmp_path / "scannet/000001-depth.png")
    (tmp_path / "a.sens").write_bytes(box_room.sens_bytes())
    assert read_sens(tmp_path / "a.sens").views[0].image is None


def test_a_repeated_frame_name_is_refused() -> None:
    frame = Frame("a", box_room.cameras()[0])
    with pytest.raises(InputError, match="distinct names, found a"):
        Capture("scene", (frame, frame))


def test_a_frame_without_a_photograph_says_so() -> None:
    with pytest.raises(InputError, match="frame a: image: expected a photograph"):
        Frame("a", box_room.cameras()[0]).read_image()


def test_depth_steps_become_metres_and_the_rest_nothing() -> None:
    steps = np.array([[0, 1000, 65535], [1, 2500, 40000]], np.uint16)
    np.testing.assert_allclose(depth_in_metres(steps, 0.001, (0, 65535)), [[0, 1, 0], [0.001, 2.5, 40]], rtol=1e-6)
    floats = np.array([[np.nan, -1.0, np.inf, 2.0]])
    np.testing.assert_array_equal(depth_in_metres(floats, 1.0), [[0, 0, 0, 2]])


def test_depth_may_be_a_numpy_file(tmp_path: Path) -> None:
    np.save(tmp_path / "d.npy", np.full((2, 3, 1), 1500.0))
    np.testing.assert_allclose(DepthFile(str(tmp_path / "d.npy")).read(), np.full((2, 3), 1.5))


def test_depth_in_eight_bits_is_refused(tmp_path: Path) -> None:
    box_room.save_image(tmp_path / "d.png", np.zeros((4, 4), np.uint8))
    with pytest.raises(InputError, match="one 16-bit channel"):
        DepthFile(str(tmp_path / "d.png")).read()


@pytest.mark.parametrize("name", ["d.png", "d.npy"])
def test_damaged_depth_is_an_error_with_the_name(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\x93NUMPY damaged")
    with pytest.raises(InputError, match=name):
        DepthFile(str(tmp_path / name)).read()


def test_grey_and_transparent_photographs_become_rgb(tmp_path: Path) -> None:
    box_room.save_image(tmp_path / "grey.png", np.full((4, 5), 7, np.uint8))
    box_room.save_image(tmp_path / "alpha.png", np.full((4, 5, 4), 9, np.uint8))
    assert ImageFile(str(tmp_path / "grey.png")).read().tolist() == np.full((4, 5, 3), 7).tolist()
    assert ImageFile(str(tmp_path / "alpha.png")).read().shape == (4, 5, 3)
