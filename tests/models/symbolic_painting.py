"""Views of upright boxes, painted by casting a ray through every pixel: what the tests of `symbolic` look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.models.messages import ImagePart, Observation
from pipeline.scene.procedural.vocabulary import VOCABULARY

WIDTH, HEIGHT, FOCAL = 160, 120, 140.0
RGB = {
    "black": (15, 15, 15),
    "white": (235, 235, 235),
    "gray": (120, 120, 120),
    "red": (200, 30, 30),
    "green": (40, 150, 50),
    "blue": (40, 70, 200),
    "yellow": (230, 210, 40),
    "orange": (240, 130, 20),
    "purple": (120, 40, 160),
    "pink": (240, 140, 170),
    "brown": (110, 70, 35),
}


@dataclass(frozen=True)
class Box:
    """A box with its middle at (right, forward), its foot at `foot` and its sides (right, up, forward), metres."""

    name: str
    at: tuple[float, float]
    sides: tuple[float, float, float]
    foot: float = 0.0
    color: str = "gray"

    @property
    def low(self) -> np.ndarray:
        return np.array([self.at[0] - self.sides[0] / 2, self.foot, self.at[1] - self.sides[2] / 2])

    @property
    def high(self) -> np.ndarray:
        return self.low + np.array(self.sides)


def room(*boxes: Box) -> list[Box]:
    """A floor, a wall 5 m ahead, and the boxes."""
    floor = Box("floor", (0, 2.5), (8, 0.02, 5), foot=-0.02, color="brown")
    wall = Box("wall", (0, 5.05), (8, 3, 0.1), color="white")
    return [floor, wall, *boxes]


def paint(
    boxes: Sequence[Box],
    *,
    eye: tuple[float, float, float] = (0.0, 1.5, 0.0),
    pitch: float = 15.0,
    yaw: float = 0.0,
    vocabulary: tuple[str, ...] = VOCABULARY,
) -> ImagePart:
    """Return the view of boxes from an eye (right, up, forward), looking down by `pitch` and right by `yaw` degrees."""
    p, y = np.deg2rad(pitch), np.deg2rad(yaw)
    forward = np.array([np.sin(y) * np.cos(p), -np.sin(p), np.cos(y) * np.cos(p)])
    right = np.array([np.cos(y), 0.0, -np.sin(y)])
    down = -np.cross(forward, right)
    K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    u = (np.arange(WIDTH) + 0.5 - K[0, 2]) / FOCAL
    v = (np.arange(HEIGHT) + 0.5 - K[1, 2]) / FOCAL
    rays = u[None, :, None] * right + v[:, None, None] * down + forward
    depth = np.full((HEIGHT, WIDTH), np.inf)
    category = np.full((HEIGHT, WIDTH), -1, np.int32)
    color = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    origin = np.array(eye)
    with np.errstate(divide="ignore", invalid="ignore"):
        for box in boxes:
            near, far = (box.low - origin) / rays, (box.high - origin) / rays
            enter = np.nanmax(np.minimum(near, far), axis=-1)
            leave = np.nanmin(np.maximum(near, far), axis=-1)
            hit = (enter <= leave) & (leave > 0.05) & (enter > 0.05) & (enter < depth)
            depth[hit] = enter[hit]
            category[hit] = vocabulary.index(box.name)
            color[hit] = RGB[box.color]
    depth[np.isinf(depth)] = 0.0
    up = np.array([right[1], down[1], forward[1]])
    return ImagePart(color, Observation(category, depth.astype(np.float32), K, up, vocabulary))
