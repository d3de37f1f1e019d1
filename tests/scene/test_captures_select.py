"""Frame selection: sharp frames that show much, the same ones every time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from pipeline.geometry import Camera, look_at
from pipeline.scene.captures import Capture, Frame, open_capture, select_frames
from pipeline.scene.captures.image_files import DepthFile, ImageFile
from pipeline.scene.captures.select_frames import laplacian_variance, seen_voxels
from tests.scene import box_room

TURNS = 24
"""Frames of a walk that turns round once in the middle of the box room."""


def turning(folder: Path, *, blurred: tuple[int, ...] = (), depth: bool = True) -> Capture:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (36, 64, 3), dtype=np.uint8)
    frames = []
    for i in range(TURNS):
        angle = 2 * np.pi * i / TURNS
        eye = np.array([2.0, 1.5, 1.2])
        pose = look_at(eye, eye + np.array([np.cos(angle), np.sin(angle), 0]), np.array([0, 0, 1.0]))
        camera = Camera(box_room.cameras()[0].K, pose, 64, 36)
        image, depth_at = folder / f"{i}.png", folder / f"{i}-depth.png"
        box_room.save_image(image, noise)
        if i in blurred:
            Image.open(image).filter(ImageFilter.GaussianBlur(2)).save(image)
        box_room.save_image(depth_at, np.rint(box_room.depth_m(camera) * 1000).astype(np.uint16))
        reader = DepthFile(str(depth_at)) if depth else None
        frames.append(Frame(f"{i:02d}", camera, ImageFile(str(image)), reader))
    return Capture("turn", tuple(frames))


def names(capture: Capture) -> list[int]:
    return [int(frame.name) for frame in capture.frames]


def voxels(capture: Capture) -> int:
    found = [seen_voxels(frame, 0.1, 1.0) for frame in capture.frames]
    return len(np.unique(np.concatenate([v for v in found if isinstance(v, np.ndarray)])))


@pytest.mark.parametrize("depth", [True, False])
def test_few_frames_of_a_turn_look_all_ways(tmp_path: Path, depth: bool) -> None:
    chosen = names(select_frames(turning(tmp_path, depth=depth), 4))
    gaps = np.diff([*chosen, chosen[0] + TURNS])
    assert len(chosen) == 4
    assert gaps.min() >= 3
    assert gaps.max() <= 10


@pytest.mark.parametrize("depth", [True, False])
def test_the_same_capture_gives_the_same_frames(tmp_path: Path, depth: bool) -> None:
    capture = turning(tmp_path, depth=depth)
    assert names(select_frames(capture, 7)) == names(select_frames(capture, 7))


def test_blurred_frames_are_passed_over(tmp_path: Path) -> None:
    sharp = names(select_frames(turning(tmp_path / "a"), 6))
    blurred = tuple(sharp)
    chosen = names(select_frames(turning(tmp_path / "b", blurred=blurred), 6))
    assert len(chosen) == 6
    assert not set(chosen) & set(blurred)


def test_chosen_frames_keep_capture_order_and_stay_within_the_count(tmp_path: Path) -> None:
    capture = turning(tmp_path)
    for count in (1, 5, TURNS, TURNS + 9):
        chosen = names(select_frames(capture, count))
        assert chosen == sorted(chosen)
        assert len(chosen) == min(count, TURNS)


def test_blank_depth_is_never_chosen_and_counted(tmp_path: Path) -> None:
    capture = turning(tmp_path)
    box_room.save_image(tmp_path / "3-depth.png", np.zeros((36, 64), np.uint16))
    chosen = select_frames(capture, TURNS)
    assert 3 not in names(chosen)
    assert chosen.skip_counts == {"empty depth": 1}


def test_only_some_frames_of_a_long_capture_are_read(tmp_path: Path) -> None:
    done: list[int] = []
    assert len(select_frames(turning(tmp_path), 3, progress=done.append)) == 3
    assert done[-1] == 12


def test_a_count_below_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        select_frames(turning(tmp_path), 0)


def test_blur_lowers_sharpness_and_scale_does_not_matter_much() -> None:
    rng = np.random.default_rng(1)
    image = np.kron(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8), np.ones((10, 10, 1), np.uint8))
    soft = np.asarray(Image.fromarray(image).filter(ImageFilter.GaussianBlur(8)))
    twice = np.kron(image, np.ones((2, 2, 1), np.uint8))
    assert laplacian_variance(soft) < 0.3 * laplacian_variance(image)
    assert laplacian_variance(twice) == pytest.approx(laplacian_variance(image), rel=1e-6)
    assert laplacian_variance(np.zeros((2, 2, 3), np.uint8)) == 0


def test_kitchen_frames_cover_more_than_evenly_spread_ones(shared_data: Path) -> None:
    capture = open_capture(str(shared_data / "kitchen_7scenes"))
    chosen = select_frames(capture, 12)
    even = capture.only(capture.frames[i].name for i in np.linspace(0, 99, 12).round().astype(int))
    assert len(chosen) == len(even) == 12
    assert voxels(chosen) > 1.05 * voxels(even)
