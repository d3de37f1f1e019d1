"""Rigid poses: inverse, look-at, axis conventions and validation. Poses are world-to-camera unless named."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from schemas.errors import InputError

ROTATION_TOLERANCE = 1e-3
"""Largest |R R^T - 1| of a pose we accept: text files with 3 decimals still pass, scaled axes do not."""


def invert_rigid(pose: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, "3 4"]:
    """Return the inverse of a rigid transform [R | t], as [R^T | -R^T t], in float64."""
    pose = np.asarray(pose, np.float64)
    rotation = pose[:, :3].T
    return np.concatenate([rotation, -rotation @ pose[:, 3:]], axis=1)


def look_at(
    eye: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 4"]:
    """Return the world-to-camera pose (OpenCV axes) of a level camera at `eye` that looks at `target`.

    Args:
        eye: Camera centre, metres, world frame.
        target: Point on the optical axis; must differ from `eye`.
        up: Direction opposite to gravity, any length. When the view is straight up or down, the
            camera's roll is fixed by the world axis least aligned with `up`.

    Raises:
        ValueError: `eye` and `target` are the same point.
    """
    eye, forward = np.asarray(eye, np.float64), np.asarray(target, np.float64) - eye
    length = np.linalg.norm(forward)
    if not length > 0:
        raise ValueError(f"look_at needs two different points, got {eye} twice")
    forward = forward / length
    up = np.asarray(up, np.float64) / np.linalg.norm(up)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-9:
        right = np.cross(forward, np.eye(3)[np.abs(up).argmin()])
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.concatenate([rotation, -(rotation @ eye)[:, None]], axis=1)


def nearest_rigid(pose: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, "3 4"]:
    """Return the pose with the rotation nearest to its own.

    Files hold a few decimals; inverting by the transpose would turn that error into one of the camera's place that
    grows with its distance from the origin.
    """
    left, _, right = np.linalg.svd(pose[:, :3])
    return np.concatenate([left @ right, pose[:, 3:]], axis=1)


def opengl_to_opencv(camera_to_world: Float[np.ndarray, "r 4"]) -> Float[np.ndarray, "3 4"]:
    """Return a camera-to-world pose in OpenCV axes from one in OpenGL axes (y up, looking down -z)."""
    return np.asarray(camera_to_world, np.float64)[:3] * np.array([1.0, -1.0, -1.0, 1.0])


def validate_pose(pose: Float[np.ndarray, "r 4"], subject: object) -> Float[np.ndarray, "3 4"]:
    """Return the pose as a finite, rigid 3x4 float64 array.

    Args:
        pose: 3x4 or 4x4 transform.
        subject: File and frame, for the message.

    Raises:
        InputError: An entry is NaN or infinite, or the rotation is not orthonormal and right-handed.
    """
    pose = np.asarray(pose, np.float64)[:3]
    if not np.isfinite(pose).all():
        raise InputError(subject, field="pose", expected="finite numbers", found="NaN or infinity")
    rotation = pose[:, :3]
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > ROTATION_TOLERANCE:
        raise InputError(
            subject, field="pose", expected="a rotation (orthonormal rows)", found=f"|R R^T - 1| = {error:.3g}"
        )
    if np.linalg.det(rotation) < 0:
        raise InputError(subject, field="pose", expected="a right-handed rotation", found="a mirrored one")
    return pose
