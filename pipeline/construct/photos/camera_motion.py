"""Small motions of a camera, in its own axes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from pipeline.geometry import Camera


def moved(camera: Camera, twist: Float[np.ndarray, "6"]) -> Camera:
    """Return the camera after points before it moved by a translation (metres) and a rotation vector (radians)."""
    angle = float(np.linalg.norm(twist[3:]))
    x, y, z = twist[3:] / max(angle, np.finfo(float).tiny)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    pose = rotation @ camera.world_to_camera
    pose[:, 3] += twist[:3]
    return camera.moved_to(pose)
