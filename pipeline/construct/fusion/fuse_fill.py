"""Points where photographs show something and no depth says how far it is: glass, screens, dark and far things.

Depth is guessed by letting the surroundings grow together, frame by frame: what one frame closed is a surface for the
next. A guess that some depth image looks through is taken back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from pipeline.construct.fusion.fuse_colors import nearest_surface
from pipeline.construct.fusion.fuse_surface import Points
from pipeline.geometry import Camera
from pipeline.scene.captures import Frame

STEP_PX = 4
"""Pixels of the photograph between guessed points: a guess deserves no finer ones."""
LEAST_COVERED = 0.1
"""Share of a picture that must have a surface for the rest to be guessed from it."""
LEAST_COSINE = 0.3
"""A guessed surface that is steeper is an edge between two others: its points face the camera instead."""


def filled_points(points: Points, frames: Sequence[Frame], *, progress: Callable[[], object] | None = None) -> Points:
    """Return guessed points that close the holes the frames' cameras see in a surface.

    Args:
        points: The surface.
        frames: Frames whose cameras look for holes, in order.
        progress: Called after each frame.
    """
    known, found = points, points.take(np.zeros(len(points), bool))
    for frame in frames:
        camera = frame.camera
        coarse = camera.resized(max(1, camera.width // STEP_PX), max(1, camera.height // STEP_PX))
        nearest = nearest_surface(known, coarse).astype(np.float64)
        covered = np.isfinite(nearest)
        if LEAST_COVERED <= covered.mean() < 1.0:
            guessed = _unprojected(coarse, grown_together(np.where(covered, nearest, 0.0), covered), ~covered)
            known, found = known.joined(guessed), found.joined(guessed)
        if progress is not None:
            progress()
    return found


def grown_together(values: Float[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Return the image with unknown pixels taken from ever coarser means of the known ones; at least one is known."""
    from scipy.ndimage import zoom

    if known.all():
        return values
    height, width = values.shape
    padded = np.zeros((2, height + height % 2, width + width % 2))
    padded[0, :height, :width], padded[1, :height, :width] = np.where(known, values, 0.0), known
    total, count = padded.reshape(2, padded.shape[1] // 2, 2, -1, 2).sum(axis=(2, 4))
    coarse = grown_together(total / np.maximum(count, 1.0), count > 0)
    fine = zoom(coarse, 2, order=1, grid_mode=True, mode="nearest")[:height, :width]
    return np.where(known, values, fine)


def _unprojected(camera: Camera, depth_m: Float[np.ndarray, "h w"], chosen: Bool[np.ndarray, "h w"]) -> Points:
    local = camera.unproject(depth_m)
    rays = local / np.linalg.norm(local, axis=-1, keepdims=True)
    normals = -rays
    if min(depth_m.shape) > 1:
        sloped = np.cross(np.gradient(local, axis=0), np.gradient(local, axis=1))
        sloped /= np.maximum(np.linalg.norm(sloped, axis=-1, keepdims=True), 1e-30)
        steep = -(sloped * rays).sum(axis=-1, keepdims=True) < LEAST_COSINE
        normals = np.where(steep, normals, sloped)
    pose = camera.camera_to_world
    return Points(
        (local[chosen] @ pose[:, :3].T + pose[:, 3]).astype(np.float32),
        (normals[chosen] @ pose[:, :3].T).astype(np.float32),
        (depth_m[chosen] / camera.K[0, 0] / 2).astype(np.float32),
    )
