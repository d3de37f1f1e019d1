"""Frame folders: conventions, intrinsics that belong to other images, poses that cannot be used."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.captures import open_capture, read_frame_folder, read_seven_scenes
from schemas.errors import InputError
from tests.scene import box_room


def test_hm3d_wrong_vertical_focal_length_is_mended_and_said(tmp_path: Path) -> None:
    capture = read_frame_folder(str(box_room.write_hm3d(tmp_path / "000-hm3d-BFRyYbPCCPE")))
    assert capture.name == "000-hm3d-BFRyYbPCCPE"
    assert [frame.camera.K[1, 1] for frame in capture.frames] == pytest.approx([box_room.FOCAL] * 4)
    assert capture.frames[0].depth_lens.K[1, 1] == pytest.approx(box_room.FOCAL)
    assert [line for line in capture.warnings if "square pixels" in line and "38.1 mended to 32.0" in line]


def test_hm3d_bug_has_the_published_size(tmp_path: Path) -> None:
    # 1920 x 1080 at 90 degrees: 1141.7 is written where 960 is meant.
    folder = tmp_path / "hm3d-v0"
    box_room.save_image(folder / "0-rgb.png", np.zeros((1080, 1920, 3), np.uint8))
    np.savetxt(folder / "0.txt", np.eye(4))
    np.savetxt(folder / "intrinsic_color.txt", [[960, 0, 960], [0, 1141.678, 540], [0, 0, 1]])
    assert read_frame_folder(str(folder)).frames[0].camera.K[1, 1] == 960


def test_hm3d_right_focal_length_is_left_alone(tmp_path: Path) -> None:
    capture = read_frame_folder(str(box_room.write_hm3d(tmp_path / "hm3d", buggy=False)))
    assert capture.warnings == ()


def test_other_focal_lengths_are_left_alone(tmp_path: Path) -> None:
    folder = box_room.write_hm3d(tmp_path / "hm3d")
    np.savetxt(folder / "intrinsic_color.txt", [[32, 0, 32], [0, 35.0, 18], [0, 0, 1]])
    assert read_frame_folder(str(folder)).frames[0].camera.K[1, 1] == 35


def test_up_follows_the_convention(tmp_path: Path) -> None:
    habitat = read_frame_folder(str(box_room.write_hm3d(tmp_path / "hm3d")))
    scannet = read_frame_folder(str(box_room.write_scannet(tmp_path / "scannet")))
    for capture, up in ((habitat, (0, 1, 0)), (scannet, (0, 0, 1))):
        np.testing.assert_array_equal(capture.up, up)
        assert all(camera.world_to_camera[1, :3] @ capture.up < -0.5 for camera in capture.cameras)


def test_a_folder_that_does_not_tell_its_convention_is_refused(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "mine" / "frames")
    with pytest.raises(InputError, match="convention: expected scannet or habitat"):
        read_frame_folder(str(folder))
    assert len(open_capture(str(folder), "scannet")) == 4


def test_axes_of_the_wrong_convention_put_depth_off_the_walls(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "frames")
    frame = read_frame_folder(str(folder), "habitat").frames[0]
    depth = frame.read_depth()
    assert np.median(box_room.off_walls_m(box_room.world_points(frame.depth_lens, depth))) > 0.1


def test_infinite_and_mirrored_poses_are_skipped_and_counted(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    (folder / "000000.txt").write_text(("-inf " * 4 + "\n") * 4)
    (folder / "000001.txt").write_text("not a matrix\n")
    (folder / "000002.txt").unlink()
    capture = read_frame_folder(str(folder))
    assert [frame.name for frame in capture.frames] == ["000003"]
    assert capture.skip_counts == {"broken pose": 2, "no pose": 1}
    assert "skipped 2 of 4 frames (broken pose)" in capture.warnings[0]
    assert "NaN or infinity" in capture.warnings[0]


def test_no_usable_pose_is_an_error_that_names_the_first(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    for path in folder.glob("0*.txt"):
        path.write_text(("nan " * 4 + "\n") * 4)
    with pytest.raises(InputError, match=r"none of 4; first: .*000000.txt"):
        read_frame_folder(str(folder))


def test_rgb_only_frames_ask_for_poses(tmp_path: Path) -> None:
    folder = box_room.write_hm3d(tmp_path / "hm3d")
    for path in [*folder.glob("0*.txt"), *folder.glob("*-depth.png")]:
        path.unlink()
    with pytest.raises(InputError, match="extract frames with depth and poses"):
        read_frame_folder(str(folder))


def test_intrinsics_of_another_image_size_are_refused(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    np.savetxt(folder / "intrinsic_color.txt", [[960, 0, 960], [0, 960, 540], [0, 0, 1]])
    with pytest.raises(InputError, match="principal point near the middle of 64 x 36"):
        read_frame_folder(str(folder))


def test_a_missing_depth_image_leaves_the_frame_without_depth(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    (folder / "000001-depth.png").unlink()
    capture = read_frame_folder(str(folder))
    assert [frame.depth is None for frame in capture.frames] == [False, True, False, False]
    assert capture.warnings == ("1 of 4 frames have no depth image",)
    with pytest.raises(InputError, match="frame 000001: depth"):
        capture.frames[1].read_depth()


def test_nested_numbers_sort_as_numbers(tmp_path: Path) -> None:
    folder = box_room.write_nested(tmp_path / "scannet")
    assert [frame.name for frame in read_frame_folder(str(folder)).frames] == ["0", "9", "18", "27"]


def test_extrinsics_that_are_not_the_identity_are_said(tmp_path: Path) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    np.savetxt(folder / "extrinsic_color.txt", np.eye(4))
    np.savetxt(folder / "extrinsic_depth.txt", np.diag([1, 1, 1, 2]))
    (note,) = read_frame_folder(str(folder)).warnings
    assert "extrinsic_depth.txt is not the identity" in note


@pytest.mark.parametrize("name", ["000000-rgb.png", "intrinsic_color.txt"])
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    folder = box_room.write_scannet(tmp_path / "scannet")
    (folder / name).write_bytes(b"garbage")
    with pytest.raises(InputError, match=name):
        read_frame_folder(str(folder))


def test_seven_scenes_marks_both_invalid_depths(tmp_path: Path) -> None:
    frame = read_seven_scenes(str(box_room.write_seven_scenes(tmp_path / "seq"))).frames[0]
    depth = frame.read_depth()
    assert (depth[:2, :3] == 0).all()
    assert depth.max() < 10


def test_seven_scenes_without_intrinsics_takes_the_published_ones(tmp_path: Path) -> None:
    folder = box_room.write_seven_scenes(tmp_path / "seq-01")
    (folder / "camera-intrinsics.txt").unlink()
    capture = read_seven_scenes(str(folder))
    assert capture.frames[0].depth_lens.K[0, 0] == 585
    assert (capture.frames[0].camera.width, capture.frames[0].camera.height) == (640, 480)
    assert "585" in capture.warnings[0]
    # The photographs' own lens is fitted; without it they are taken at the data set's word.
    assert capture.frames[0].camera.K[0, 0] != 585
    assert read_seven_scenes(str(folder), register=False).frames[0].camera.K[0, 0] == 585
    # These pictures are of another size, which must not pass unseen.
    with pytest.raises(InputError, match="expected 640 x 480 pixels"):
        capture.frames[0].read_image()


def test_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found no file of any of them"):
        open_capture(str(tmp_path))
    with pytest.raises(InputError, match="nothing there"):
        open_capture(str(tmp_path / "absent"))
    with pytest.raises(InputError, match="no frames"):
        read_frame_folder(str(tmp_path), "scannet")
    with pytest.raises(InputError, match="no frames"):
        read_seven_scenes(str(tmp_path))


def test_folders_are_told_apart_when_their_format_is_not_named(tmp_path: Path) -> None:
    for name, write in box_room.WRITERS.items():
        assert len(open_capture(str(write(tmp_path / name)))) == 4
        shutil.rmtree(tmp_path / name)
