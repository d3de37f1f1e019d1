"""Which way is up in a capture that does not say: people hold cameras level, whichever way they look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pipeline.geometry import Camera

LEAST_SPREAD = 0.02
"""Least mean square of the image x axes along their second direction: cameras that all look one way lie on a line of
x axes, whose perpendicular could be anything."""


def estimate_up(cameras: Sequence[Camera]) -> Float[np.ndarray, "3"]:
    """Return the unit direction the cameras' images have upward, taken as opposite to gravity.

    A level camera's x axis is horizontal, so up is the direction these axes have least of. Where the cameras hardly
    turn that is undetermined, and the mean of the images' up is taken, which leans as the cameras do.

    Args:
        cameras: At least one.
    """
    rotations = np.stack([camera.world_to_camera[:, :3] for camera in cameras])
    mean = -rotations[:, 1].mean(axis=0)
    spread, directions = np.linalg.eigh(rotations[:, 0].T @ rotations[:, 0] / len(rotations))
    up = directions[:, 0] if spread[1] >= LEAST_SPREAD else mean
    up = up if up @ mean >= 0 else -up
    length = np.linalg.norm(up)
    # Cameras that cancel out say nothing; any direction is as good.
    return up / length if length > 0 else np.array([0.0, 0.0, 1.0])
