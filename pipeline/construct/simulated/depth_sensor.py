"""What a structured-light depth camera makes of true depth: steps, jitter at edges, and holes.

Noise is that of Barron and Malik (2013), used by ICL-NUIM (Handa et al. 2014): a pixel looks a little beside itself,
and depth comes in steps of an eighth of a pixel of disparity. Holes are left where the projector's light does not
reach, where a surface is grazed, out of range, and on what the caller says: glass and mirrors.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from pipeline.geometry import Camera
from schemas.errors import InputError

FOCAL_PX, WIDTH_PX = 585.0, 640
"""Lens of the sensor's own images (Kinect); noise in pixels scales with the image's width."""
BASELINE_M = 0.075
"""Distance from the camera to the projector, which stands to its right."""
STEPS_PER_PIXEL = 8
"""Steps of disparity in a pixel."""
DISPARITY_SIGMA = 1.0 / 6.0
"""Deviation of disparity before it is rounded, steps."""
LATERAL_SIGMA_PX = 0.5
"""Deviation of where a pixel looks, in pixels of the sensor's own images."""
RANGE_M = (0.4, 5.0)
"""Distances that are measured."""
LEAST_COSINE = 0.15
"""Cosine between ray and normal below which too little light comes back: 81 degrees."""


def structured_light(
    depth_m: Float[np.ndarray, "H W"],
    camera: Camera,
    rng: np.random.Generator,
    blind: Bool[np.ndarray, "H W"] | None = None,
) -> Float32[np.ndarray, "H W"]:
    """Return the depth image a sensor would have given, metres, 0 for a hole.

    Args:
        depth_m: True z-depth, metres, 0 where there is nothing.
        camera: Its lens.
        rng: Source of the noise.
        blind: Pixels that send no light back, such as mirrors; None for none.

    Raises:
        InputError: The image is not of the camera's size.
    """
    if depth_m.shape != (camera.height, camera.width):
        expected = f"{camera.width} x {camera.height}, the camera's"
        raise InputError("depth", field="size", expected=expected, found=depth_m.shape[::-1])
    true = np.asarray(depth_m, np.float64)
    lit = (true >= RANGE_M[0]) & (true <= RANGE_M[1]) & ~_in_shadow(true, camera)
    lit &= _cosines(true, camera) >= LEAST_COSINE
    if blind is not None:
        lit &= ~blind
    rows, columns = np.indices(true.shape)
    beside = rng.normal(0.0, LATERAL_SIGMA_PX * camera.width / WIDTH_PX, (2, *true.shape)).round().astype(int)
    at = np.clip(rows + beside[0], 0, camera.height - 1), np.clip(columns + beside[1], 0, camera.width - 1)
    seen = np.where(lit, true, 0.0)[at]
    steps_m = FOCAL_PX * BASELINE_M * STEPS_PER_PIXEL
    with np.errstate(divide="ignore"):
        steps = (steps_m / seen + rng.normal(0.0, DISPARITY_SIGMA, true.shape)).round()
    return np.where(lit & (seen > 0), steps_m / steps, 0.0).astype(np.float32)


def _in_shadow(depth_m: Float64[np.ndarray, "H W"], camera: Camera) -> Bool[np.ndarray, "H W"]:
    """Return where something nearer stands between the surface and the projector.

    A pixel's column in the projector is its own less the disparity; one that comes to lie right of a pixel that was
    to its right in the image is behind that one.
    """
    with np.errstate(divide="ignore"):
        column = np.arange(camera.width) + 0.5 - camera.K[0, 0] * BASELINE_M / depth_m
    column[depth_m == 0] = np.inf
    leftmost = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    return leftmost < column - 0.5


def _cosines(depth_m: Float64[np.ndarray, "H W"], camera: Camera) -> Float64[np.ndarray, "H W"]:
    """Return the cosine between each pixel's ray and the normal of the surface it meets; low across depth jumps."""
    points = camera.unproject(depth_m)
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    lengths = np.linalg.norm(normals, axis=2) * np.linalg.norm(points, axis=2)
    return np.abs((normals * points).sum(axis=2)) / np.where(lengths > 0, lengths, np.inf)
