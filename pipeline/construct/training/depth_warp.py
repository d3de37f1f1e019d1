"""Depth of one lens as another lens sees it, for depth cameras that sit beside the photographs'."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from pipeline.geometry import Camera

HIDDEN = 0.95
"""Share of the nearest neighbour's inverse depth below which a pixel is a glimpse past a nearer surface: 5 % deeper."""


def inverse_depth_in(depth_m: Float32[np.ndarray, "h w"], lens: Camera, camera: Camera) -> Float32[np.ndarray, "H W"]:
    """Return 1 / depth in the camera's pixels, 1/metres; 0 where nothing is known.

    The measured points are moved to the camera and the nearest of a pixel wins. A pixel that is much deeper than one
    beside it may show what lies behind, through the gaps between moved points: it is left out. Where lens and camera
    are the same, the image keeps every pixel.

    Args:
        depth_m: z-depth of the lens, metres, 0 where there is none.
        lens: The depth camera.
        camera: Where the image is wanted.
    """
    inverse = np.zeros((camera.height, camera.width), np.float32)
    if _same(lens, camera):
        np.divide(1.0, depth_m, out=inverse, where=depth_m > 0)
        return inverse
    points = lens.unproject(depth_m)[depth_m > 0]
    to_camera = camera.world_to_camera[:, :3] @ lens.camera_to_world[:, :3]
    offset = camera.world_to_camera[:, :3] @ lens.center + camera.world_to_camera[:, 3]
    x, y, z = to_camera @ points.T + offset[:, None]
    ahead = z > 0
    x, y, z = x[ahead], y[ahead], z[ahead]
    column = np.floor(camera.K[0, 0] * x / z + camera.K[0, 2])
    row = np.floor(camera.K[1, 1] * y / z + camera.K[1, 2])
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    pixel = row[inside].astype(np.int64) * camera.width + column[inside].astype(np.int64)
    np.maximum.at(inverse.reshape(-1), pixel, (1.0 / z[inside]).astype(np.float32))
    inverse[inverse < HIDDEN * _largest_beside(inverse)] = 0.0
    return inverse


def _same(lens: Camera, camera: Camera) -> bool:
    sizes = (lens.width, lens.height) == (camera.width, camera.height)
    return sizes and np.array_equal(lens.K, camera.K) and np.array_equal(lens.world_to_camera, camera.world_to_camera)


def _largest_beside(image: Float32[np.ndarray, "H W"]) -> Float32[np.ndarray, "H W"]:
    """Return the largest of each pixel's 3 x 3 neighbourhood."""
    padded = np.pad(image, 1)
    across = np.maximum(np.maximum(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:])
    return np.maximum(np.maximum(across[:-2], across[1:-1]), across[2:])
