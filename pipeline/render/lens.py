"""A camera as the kernels and the reference read it: one centre, one set of clamp limits, plain float64 numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from pipeline.geometry import Camera

CLAMP_MARGIN = 0.3
"""How far beyond the image the Jacobian is still evaluated, as a share of the half field of view's tangent."""


@dataclass(frozen=True, slots=True)
class Lens:
    """What projection needs of a camera."""

    rotation: Float64[np.ndarray, "3 3"]
    """World to camera."""
    center: Float64[np.ndarray, "3"]
    """Camera centre in the world, metres: the point the pose maps to zero, also where the rotation is sloppy."""
    focal: tuple[float, float]
    """fx, fy, pixels."""
    principal: tuple[float, float]
    """cx, cy, pixels."""
    x_limits: tuple[float, float]
    """Smallest and largest x/z at which the Jacobian is evaluated."""
    y_limits: tuple[float, float]
    """Smallest and largest y/z at which the Jacobian is evaluated."""

    @staticmethod
    def of(camera: Camera) -> Lens:
        """Return the lens of a camera."""
        pose, K = camera.world_to_camera, camera.K
        x_margin = CLAMP_MARGIN * camera.width / (2 * K[0, 0])
        y_margin = CLAMP_MARGIN * camera.height / (2 * K[1, 1])
        return Lens(
            rotation=np.ascontiguousarray(pose[:, :3]),
            center=-np.linalg.solve(pose[:, :3], pose[:, 3]),
            focal=(float(K[0, 0]), float(K[1, 1])),
            principal=(float(K[0, 2]), float(K[1, 2])),
            x_limits=(float(-K[0, 2] / K[0, 0] - x_margin), float((camera.width - K[0, 2]) / K[0, 0] + x_margin)),
            y_limits=(float(-K[1, 2] / K[1, 1] - y_margin), float((camera.height - K[1, 2]) / K[1, 1] + y_margin)),
        )

    def packed(self, near: float) -> Float64[np.ndarray, "21"]:
        """Return rotation (9), centre (3), focal (2), principal (2), x and y limits (4), near: what `project` takes."""
        numbers = [*self.rotation.ravel(), *self.center, *self.focal, *self.principal, *self.x_limits, *self.y_limits]
        return np.array([*numbers, near], np.float64)
