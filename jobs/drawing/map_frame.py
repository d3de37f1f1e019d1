"""The frame that maps are drawn in: a plane that looks down on a scene, cut to what the scene fills."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

LONG_SIDE = 720
"""Pixels of the longer side of a map on a page."""
OUTLIERS = (0.5, 99.5)
"""Percentiles of the Gaussians that the map reaches: floaters outside would shrink the rooms."""
MARGIN_M = 0.3


@dataclass(frozen=True, slots=True)
class MapFrame:
    """A plane that looks down: x to the right, y downwards, metres."""

    right: Float[np.ndarray, "3"]
    """Unit vector of x, world frame."""
    down: Float[np.ndarray, "3"]
    """Unit vector of y, world frame."""
    low: Float[np.ndarray, "2"]
    """Upper left corner, metres."""
    size: Float[np.ndarray, "2"]
    """Width and height, metres."""

    def at(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Return where points lie on the map, metres from its upper left corner."""
        return np.asarray(points, np.float64) @ np.stack([self.right, self.down], axis=1) - self.low

    def per_metre(self, long_side: int) -> float:
        """Return pixels a metre on a map whose longer side has `long_side`."""
        return long_side / float(self.size.max())

    def pixels(self, long_side: int) -> tuple[int, int]:
        """Return width and height of that map, pixels."""
        width, height = (max(16, round(float(side) * self.per_metre(long_side))) for side in self.size)
        return width, height

    def as_data(self) -> dict[str, Any]:
        """Return plain data for the page."""
        return {
            "right": [round(float(value), 6) for value in self.right],
            "down": [round(float(value), 6) for value in self.down],
            "low": [round(float(value), 3) for value in self.low],
            "size": [round(float(value), 3) for value in self.size],
        }


def axes_of(up: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the map's x and y in the world: x follows the world's x, or its y where that stands upright."""
    up = np.asarray(up, np.float64) / np.linalg.norm(up)
    flat = [axis - up * (axis @ up) for axis in np.eye(3)]
    right = flat[0] if np.linalg.norm(flat[0]) > 0.5 else flat[1]
    right = right / np.linalg.norm(right)
    return right, np.cross(-up, right)


def up_of(poses: Sequence[Sequence[float]]) -> Float[np.ndarray, "3"]:
    """Return about where up is, from poses alone: people hold cameras level more often than not."""
    rows = np.asarray(poses, np.float64).reshape(-1, 3, 4)
    mean = -rows[:, 1, :3].mean(axis=0) if len(rows) else np.zeros(3)
    return mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-6 else np.array([0.0, 0.0, 1.0])


def frame_of(
    up: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"], stands: Float[np.ndarray, "k 3"]
) -> MapFrame:
    """Return the frame of a map that reaches nearly all points and every place where a camera stands.

    Args:
        up: Unit vector opposite to gravity.
        points: What the scene consists of; may be empty.
        stands: Camera centres.
    """
    right, down = axes_of(up)
    plane = np.stack([right, down], axis=1)
    corners = [np.asarray(stands, np.float64) @ plane]
    if len(points):
        corners.append(np.percentile(np.asarray(points, np.float64) @ plane, OUTLIERS, axis=0))
    every = np.concatenate(corners) if sum(map(len, corners)) else np.zeros((1, 2))
    low, high = every.min(axis=0) - MARGIN_M, every.max(axis=0) + MARGIN_M
    return MapFrame(right, down, low, high - low)
