"""Cameras, poses, rotations and frusta in one convention (docs/conventions.md)."""

from pipeline.geometry.camera import Camera
from pipeline.geometry.covariance import covariances
from pipeline.geometry.frustum import points_in_frustum
from pipeline.geometry.pose import invert_rigid, look_at, nearest_rigid, opengl_to_opencv, validate_pose
from pipeline.geometry.quaternion import normalise_quats, quats_to_rotations, rotations_to_quats

__all__ = [
    "Camera",
    "covariances",
    "invert_rigid",
    "look_at",
    "nearest_rigid",
    "normalise_quats",
    "opengl_to_opencv",
    "points_in_frustum",
    "quats_to_rotations",
    "rotations_to_quats",
    "validate_pose",
]
