"""COLMAP models: text and binary give the same views, and other lenses are refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.geometry import rotations_to_quats
from pipeline.scene.captures import read_colmap
from schemas.errors import InputError
from tests.scene.making import camera

CAMERAS = "# Camera list\n1 PINHOLE 32 24 30 31 15.5 11.5\n7 SIMPLE_PINHOLE 64 48 50 32 24\n"
POSES = {"b/2.jpg": camera((3.0, 0.0, 1.0)).world_to_camera, "a/1.jpg": camera((0.0, 2.0, 2.0)).world_to_camera}


def quat_and_shift(pose: np.ndarray) -> list[float]:
    return [*rotations_to_quats(pose[:, :3]).tolist(), *pose[:, 3].tolist()]


def write_text(folder: Path, cameras: str = CAMERAS, images: str | None = None, points: str = "1.0 2.0 -1") -> str:
    lines = ["# Image list", "# two lines an image"]
    for i, (name, pose) in enumerate(POSES.items(), 1):
        lines += [" ".join(repr(v) for v in [i, *quat_and_shift(pose), [7, 1][i - 1]]) + f" {name}", points]
    (folder / "cameras.txt").write_text(cameras)
    (folder / "images.txt").write_text("\n".join(lines) + "\n" if images is None else images)
    return str(folder)


def binary(points: int = 2) -> tuple[bytes, bytes]:
    cameras = struct.pack("<Q", 2) + struct.pack("<iiQQ4d", 1, 1, 32, 24, 30, 31, 15.5, 11.5)
    cameras += struct.pack("<iiQQ3d", 7, 0, 64, 48, 50, 32, 24)
    images = struct.pack("<Q", len(POSES))
    for i, (name, pose) in enumerate(POSES.items(), 1):
        images += struct.pack("<i7di", i, *quat_and_shift(pose), [7, 1][i - 1]) + name.encode() + b"\0"
        images += struct.pack("<Q", points) + bytes(24 * points)
    return cameras, images


def write_binary(folder: Path, cameras: bytes, images: bytes) -> str:
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    return str(folder)


def check(folder: str) -> None:
    views = read_colmap(folder).views
    assert [view.name for view in views] == ["1", "2"]
    np.testing.assert_allclose(views[0].camera.world_to_camera, POSES["a/1.jpg"], atol=1e-12)
    np.testing.assert_allclose(views[1].camera.world_to_camera, POSES["b/2.jpg"], atol=1e-12)
    np.testing.assert_allclose(views[0].camera.K, [[30, 0, 15.5], [0, 31, 11.5], [0, 0, 1]])
    np.testing.assert_allclose(views[1].camera.K, [[50, 0, 32], [0, 50, 24], [0, 0, 1]])
    assert (views[1].camera.width, views[1].camera.height) == (64, 48)


def test_text_model_reads_poses_as_they_are(tmp_path: Path) -> None:
    check(write_text(tmp_path))


def test_text_model_with_empty_point_lines_reads(tmp_path: Path) -> None:
    check(write_text(tmp_path, points=""))


@pytest.mark.parametrize("points", [0, 3])
def test_binary_model_reads_the_same(tmp_path: Path, points: int) -> None:
    check(write_binary(tmp_path, *binary(points)))


def test_binary_is_preferred_over_text(tmp_path: Path) -> None:
    write_text(tmp_path, images="broken")
    check(write_binary(tmp_path, *binary()))


def test_image_names_with_spaces_and_photographs_are_found(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "my photo.jpg").touch()
    write_text(tmp_path, images="1 1 0 0 0 0 0 0 1 my photo.jpg\n\n")
    view = read_colmap(str(tmp_path), images=str(tmp_path / "images")).views[0]
    assert view.name == "my photo"
    assert view.image == str(tmp_path / "images" / "my photo.jpg")


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV"])
def test_lens_with_distortion_is_refused_by_name(tmp_path: Path, model: str) -> None:
    with pytest.raises(InputError, match=f"line 1: model: expected PINHOLE or SIMPLE_PINHOLE.*found {model}"):
        read_colmap(write_text(tmp_path, cameras=f"1 {model} 32 24 30 15 11 0.1 0 0 0 0\n"))


def test_binary_lens_with_distortion_is_refused_by_name(tmp_path: Path) -> None:
    cameras = struct.pack("<Q", 1) + struct.pack("<iiQQ4d", 1, 2, 32, 24, 30, 15, 11, 0.1)
    with pytest.raises(InputError, match="found SIMPLE_RADIAL"):
        read_colmap(write_binary(tmp_path, cameras, binary()[1]))


@pytest.mark.parametrize("quat", ["nan 0 0 0", "0 0 0 0", "inf 0 0 0"])
def test_broken_pose_is_an_error_or_skipped(tmp_path: Path, quat: str) -> None:
    folder = write_text(tmp_path, images=f"1 {quat} 0 0 0 1 bad.jpg\n\n2 1 0 0 0 0 0 0 1 good.jpg\n\n")
    with pytest.raises(InputError, match=r"bad\.jpg: pose"):
        read_colmap(folder)
    found = read_colmap(folder, strict=False)
    assert [view.name for view in found.views] == ["good"]
    assert len(found.skipped) == 1


def test_infinite_translation_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pose"):
        read_colmap(write_text(tmp_path, images="1 1 0 0 0 inf 0 0 1 a.jpg\n\n"))


@pytest.mark.parametrize(
    ("cameras", "images"),
    [
        (CAMERAS, "1 1 0 0 0 0 0 0 9 a.jpg\n\n"),
        (CAMERAS, "1 1 0 0 0 0 0 0 1\n\n"),
        (CAMERAS, "one 1 0 0 0 0 0 0 x a.jpg\n\n"),
        (CAMERAS, "# nothing\n"),
        ("1 PINHOLE 32 24 30\n", None),
        ("1 PINHOLE wide 24 30 31 15 11\n", None),
        ("1\n", None),
        ("", None),
    ],
)
def test_malformed_text_is_an_input_error(tmp_path: Path, cameras: str, images: str | None) -> None:
    with pytest.raises(InputError):
        read_colmap(write_text(tmp_path, cameras=cameras, images=images), strict=False)


def test_truncated_binary_is_refused_at_every_byte(tmp_path: Path) -> None:
    cameras, images = binary()
    for end in range(len(images)):
        with pytest.raises(InputError):
            read_colmap(write_binary(tmp_path, cameras, images[:end]))
    for end in range(len(cameras)):
        with pytest.raises(InputError):
            read_colmap(write_binary(tmp_path, cameras[:end], images))


def test_flipped_bytes_are_read_or_refused_with_the_file_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    subjects = []
    for _ in range(300):
        parts = [bytearray(part) for part in binary()]
        for part in parts:
            part[rng.integers(len(part))] = rng.integers(256)
        try:
            read_colmap(write_binary(tmp_path, *map(bytes, parts)), strict=False)
        except InputError as error:
            subjects.append(error.subject)
    assert subjects
    assert all(subject.startswith(str(tmp_path)) for subject in subjects)


def test_missing_model_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found neither"):
        read_colmap(str(tmp_path))
