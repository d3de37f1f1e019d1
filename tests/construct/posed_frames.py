"""Frames in memory: the box room, and a plate before a wall seen by two lenses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Camera
from pipeline.scene.captures import Frame
from tests.scene import box_room

PLATE_M, WALL_M, PLATE_HALF_M = 1.0, 2.0, 0.25


@dataclass(frozen=True)
class Held:
    """An image or a depth image that is at hand."""

    pixels: np.ndarray

    def read(self) -> np.ndarray:
        return self.pixels


def frame(name: str, camera: Camera, image: np.ndarray | None, depth: np.ndarray | None, lens: Camera | None = None):
    return Frame(
        name,
        camera,
        None if image is None else Held(image),
        None if depth is None else Held(depth.astype(np.float32)),
        lens,
    )


def room_frames(noise_m: float = 0.0, *, width: int = 128, seed: int = 0) -> list[Frame]:
    """The box room from its four places, each twice with a small step between, with noisy depth."""
    rng, frames = np.random.default_rng(seed), []
    for i, camera in enumerate(box_room.cameras(width=width, height=width * 9 // 16)):
        for step in range(2):
            pose = camera.world_to_camera.copy()
            pose[0, 3] += 0.05 * step
            moved = camera.moved_to(pose)
            depth = box_room.depth_m(moved)
            depth = depth + rng.normal(0, noise_m, depth.shape) if noise_m else depth
            frames.append(frame(f"{i}-{step}", moved, box_room.picture(moved), depth))
    return frames


def plate_depth(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return exact z-depth and where the plate is, for a camera without rotation."""
    rays, center = camera.unproject(np.ones((camera.height, camera.width))), camera.center
    at_plate = center + rays * (PLATE_M - center[2])
    plate = (np.abs(at_plate[..., :2]) <= PLATE_HALF_M).all(axis=-1)
    return np.where(plate, PLATE_M - center[2], WALL_M - center[2]), plate


def plate_frames() -> list[Frame]:
    """A red plate before a blue wall; photographs are taken 8 cm to the left of depth, with another focal length."""
    frames = []
    for i, x in enumerate((-0.3, -0.1, 0.1, 0.3)):
        lens = _front(x, 150.0)
        camera = _front(x - 0.08, 130.0)
        depth, _ = plate_depth(lens)
        _, plate = plate_depth(camera)
        image = np.where(plate[..., None], [255, 0, 0], [0, 0, 255]).astype(np.uint8)
        frames.append(frame(str(i), camera, image, depth, lens))
    return frames


def _front(x: float, focal: float) -> Camera:
    K = np.array([[focal, 0, 80.0], [0, focal, 60.0], [0, 0, 1]])
    return Camera(K, np.hstack([np.eye(3), [[-x], [0.0], [0.0]]]), 160, 120)
