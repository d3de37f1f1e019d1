"""The pinhole camera every stage shares. Distorted cameras are undistorted or refused by the loaders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pipeline.geometry.pose import invert_rigid, validate_pose
from schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera with a pose: OpenCV axes (x right, y down, z forward), pixel centres at +0.5.

    Raises:
        InputError: Focal lengths are not positive, K has skew, the size is not positive, or the pose is
            not a finite rigid transform.
    """

    K: Float[np.ndarray, "3 3"]
    """Intrinsics in pixels, float64; no skew."""
    world_to_camera: Float[np.ndarray, "3 4"]
    """Pose [R | t], float64, metres."""
    width: int
    """Image width, pixels."""
    height: int
    """Image height, pixels."""

    def __post_init__(self) -> None:
        K = np.array(self.K, np.float64)
        if K.shape != (3, 3) or not np.isfinite(K).all():
            raise InputError("camera", field="K", expected="a finite 3x3 matrix", found=K.tolist())
        if not (K[0, 0] > 0 and K[1, 1] > 0):
            raise InputError("camera", field="K", expected="focal lengths above 0", found=(K[0, 0], K[1, 1]))
        if abs(K[0, 1]) > 1e-6 * K[0, 0]:
            raise InputError("camera", field="K", expected="no skew", found=K[0, 1])
        if self.width < 1 or self.height < 1:
            raise InputError("camera", field="size", expected="at least 1 x 1 pixel", found=(self.width, self.height))
        pose = np.array(validate_pose(self.world_to_camera, "camera"))
        K.setflags(write=False)
        pose.setflags(write=False)
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "world_to_camera", pose)

    @property
    def center(self) -> Float[np.ndarray, "3"]:
        """Camera centre in the world, metres."""
        return -self.world_to_camera[:, :3].T @ self.world_to_camera[:, 3]

    @property
    def camera_to_world(self) -> Float[np.ndarray, "3 4"]:
        """Inverse pose."""
        return invert_rigid(self.world_to_camera)

    @property
    def forward(self) -> Float[np.ndarray, "3"]:
        """Unit viewing direction in the world."""
        return self.world_to_camera[2, :3].copy()

    def moved_to(self, world_to_camera: Float[np.ndarray, "3 4"]) -> Camera:
        """Return the same lens at another pose."""
        return replace(self, world_to_camera=world_to_camera)

    def resized(self, width: int, height: int) -> Camera:
        """Return a camera with the same field of view and another pixel grid."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return replace(self, K=scale @ self.K, width=width, height=height)

    def project(self, points: Float[np.ndarray, "N 3"]) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N"]]:
        """Return pixel coordinates and z-depth (metres) of world points.

        Pixels of points at or behind the camera plane (depth <= 0) are NaN.
        """
        local = np.asarray(points, np.float64) @ self.world_to_camera[:, :3].T + self.world_to_camera[:, 3]
        depth = local[:, 2]
        safe = np.where(depth > 0, depth, np.nan)
        pixels = np.stack(
            [self.K[0, 0] * local[:, 0] / safe + self.K[0, 2], self.K[1, 1] * local[:, 1] / safe + self.K[1, 2]], axis=1
        )
        return pixels, depth

    def unproject(self, depth_m: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "H W 3"]:
        """Return the points, in camera axes, of a z-depth image (metres) of this camera's size."""
        u = (np.arange(self.width) + 0.5 - self.K[0, 2]) / self.K[0, 0]
        v = (np.arange(self.height) + 0.5 - self.K[1, 2]) / self.K[1, 1]
        rays = np.stack([*np.meshgrid(u, v), np.ones((self.height, self.width))], axis=-1)
        return rays * np.asarray(depth_m, np.float64)[..., None]
