"""Pairwise geometry of upright boxes: gaps and overlaps of footprints, heights, volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pipeline.scene.objects import SceneObject

NEAR_M = 0.2
"""Horizontal distance within which something on a wall is over the furniture in front of that wall."""
_GRID = 10
"""Footprint samples per axis: overlaps are known to about a tenth, finer than any threshold needs."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Geometry of n objects, every array indexed by position in the object list; z is up."""

    center: Float[np.ndarray, "n 3"]
    """Box centres, metres."""
    half: Float[np.ndarray, "n 3"]
    """Half extents, metres."""
    yaw: Float[np.ndarray, "n"]
    """Rotation about z, radians."""
    gap: Float[np.ndarray, "n n"]
    """Shortest horizontal distance between footprints, metres; 0 where they touch or overlap."""
    overlap: Float[np.ndarray, "n n"]
    """Share of the row's footprint that lies within the column's, 0 to 1."""
    near: Float[np.ndarray, "n n"]
    """Share of the row's footprint within `NEAR_M` of the column's, 0 to 1."""
    vertical_gap: Float[np.ndarray, "n n"]
    """Vertical distance between boxes, metres; 0 where their heights overlap."""
    distance: Float[np.ndarray, "n n"]
    """Shortest distance between boxes, metres."""
    center_distance: Float[np.ndarray, "n n"]
    """Distance between box centres, metres."""

    @property
    def bottom(self) -> Float[np.ndarray, "n"]:
        """Lowest height, metres."""
        return self.center[:, 2] - self.half[:, 2]

    @property
    def top(self) -> Float[np.ndarray, "n"]:
        """Greatest height, metres."""
        return self.center[:, 2] + self.half[:, 2]

    @property
    def volume(self) -> Float[np.ndarray, "n"]:
        """Box volumes, cubic metres."""
        return 8.0 * self.half.prod(axis=1)

    @property
    def longest(self) -> Float[np.ndarray, "n"]:
        """Longest sides, metres."""
        return 2.0 * self.half.max(axis=1)

    def extent(self, direction: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n"]:
        """Return half the widths of the footprints along a horizontal unit vector, metres."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        along = np.abs(cos * direction[0] + sin * direction[1])
        across = np.abs(-sin * direction[0] + cos * direction[1])
        return self.half[:, 0] * along + self.half[:, 1] * across


def measure_layout(objects: Sequence[SceneObject]) -> Layout:
    """Return the pairwise geometry of the objects' boxes."""
    center = np.array([o.center for o in objects], np.float64).reshape(-1, 3)
    half = np.array([o.half_extents for o in objects], np.float64).reshape(-1, 3)
    yaw = np.array([o.yaw for o in objects], np.float64)
    corners = _footprint_points(center, half, yaw, np.array([-1.0, 1.0]))
    grid = _footprint_points(center, half, yaw, (2 * np.arange(_GRID) + 1) / _GRID - 1)
    overlap = (_outside(grid, center, half, yaw) <= 1e-9).mean(axis=2)
    near = (_outside(grid, center, half, yaw) <= NEAR_M).mean(axis=2)
    # Two convex shapes that do not meet are closest at a corner of one of them.
    corner_gap = _outside(corners, center, half, yaw).min(axis=2)
    gap = np.minimum(corner_gap, corner_gap.T)
    gap[_meet(center, half, yaw)] = 0.0
    top, bottom = center[:, 2] + half[:, 2], center[:, 2] - half[:, 2]
    over = bottom[:, None] - top[None]
    vertical = np.maximum(0.0, np.maximum(over, over.T))
    center_distance = np.linalg.norm(center[:, None] - center[None], axis=2)
    return Layout(center, half, yaw, gap, overlap, near, vertical, np.hypot(gap, vertical), center_distance)


def _meet(
    center: Float[np.ndarray, "n 3"], half: Float[np.ndarray, "n 3"], yaw: Float[np.ndarray, "n"]
) -> Bool[np.ndarray, "n n"]:
    """Return which footprints share a point: rectangles do unless a line along a side of one of them parts them."""
    turn = yaw[None] - yaw[:, None]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    east, north = np.moveaxis(center[None, :, :2] - center[:, None, :2], 2, 0)
    x = np.cos(yaw)[:, None] * east + np.sin(yaw)[:, None] * north
    y = -np.sin(yaw)[:, None] * east + np.cos(yaw)[:, None] * north
    beside = np.abs(x) > half[:, None, 0] + cos * half[None, :, 0] + sin * half[None, :, 1]
    beyond = np.abs(y) > half[:, None, 1] + sin * half[None, :, 0] + cos * half[None, :, 1]
    parted = beside | beyond
    return ~(parted | parted.T)


def _footprint_points(
    center: Float[np.ndarray, "n 3"],
    half: Float[np.ndarray, "n 3"],
    yaw: Float[np.ndarray, "n"],
    steps: Float[np.ndarray, "s"],
) -> Float[np.ndarray, "n p 2"]:
    local = half[:, None, :2] * np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y = local[..., 0], local[..., 1]
    return center[:, None, :2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _outside(
    points: Float[np.ndarray, "n p 2"],
    center: Float[np.ndarray, "m 3"],
    half: Float[np.ndarray, "m 3"],
    yaw: Float[np.ndarray, "m"],
) -> Float[np.ndarray, "n m p"]:
    """Return how far each point lies outside each footprint, metres; 0 inside."""
    delta = points[:, None] - center[None, :, None, :2]
    cos, sin = np.cos(yaw)[None, :, None], np.sin(yaw)[None, :, None]
    x = cos * delta[..., 0] + sin * delta[..., 1]
    y = -sin * delta[..., 0] + cos * delta[..., 1]
    return np.hypot(
        np.maximum(0.0, np.abs(x) - half[None, :, None, 0]), np.maximum(0.0, np.abs(y) - half[None, :, None, 1])
    )
