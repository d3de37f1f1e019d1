"""Surfaces that run on beyond a box: the floor a thing stands on, the wall behind it. They are no part of it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Float64

BESIDE = 0.15
"""Width of the strip looked at on each side of a box, as a share of the box..."""
LEAST_PX = 4
"""... and at least so many pixels."""
NEAR_M, NEAR_SHARE = 0.02, 0.01
"""A pixel lies on a plane within this distance in depth, metres, or this share of its depth where that is more."""
MOSTLY = 0.6
"""Share of a strip that lies on its plane, or the strip shows no single surface."""
FEWEST = 40
"""Pixels a strip needs."""
ROUNDS = 5
"""Of fitting the plane and dropping what lies off it."""


def surroundings(depth_m: Float32[np.ndarray, "H W"], rows: slice, columns: slice) -> Bool[np.ndarray, "h w"]:
    """Return which pixels of a box lie on a plane that fills a strip beside, over or under the box.

    Inverse depth of a plane is linear in the pixel, so planes are fitted without the lens.

    Args:
        depth_m: z-depth of the whole image, 0 where there is none.
        rows: The box's rows.
        columns: The box's columns.
    """
    height, width = rows.stop - rows.start, columns.stop - columns.start
    tall, wide = (max(LEAST_PX, round(BESIDE * side)) for side in (height, width))
    strips = (
        (slice(rows.stop, rows.stop + tall), columns),
        (slice(max(0, rows.start - tall), rows.start), columns),
        (rows, slice(max(0, columns.start - wide), columns.start)),
        (rows, slice(columns.stop, columns.stop + wide)),
    )
    inside = depth_m[rows, columns]
    found = np.zeros(inside.shape, bool)
    v, u = np.mgrid[rows, columns]
    for strip in strips:
        plane = _plane(depth_m, *strip)
        if plane is not None:
            found |= _on_plane(plane, u, v, inside)
    return found


def _plane(depth_m: Float32[np.ndarray, "H W"], rows: slice, columns: slice) -> Float64[np.ndarray, "3"] | None:
    """Return a, b, c of 1 / z = a u + b v + c where most of a strip lies on it."""
    strip = depth_m[rows, columns]
    at_v, at_u = np.nonzero(strip)
    if len(at_v) < FEWEST:
        return None
    z = strip[at_v, at_u].astype(np.float64)
    u, v = at_u + columns.start, at_v + rows.start
    pixels = np.stack([u, v, np.ones(len(z))], axis=1)
    # Things in front of a surface are nearer: the farther half is a better start than all of it.
    on = z >= np.median(z)
    plane = np.zeros(3)
    for _ in range(ROUNDS):
        plane = np.linalg.lstsq(pixels[on], 1 / z[on])[0]
        on = _on_plane(plane, u, v, z)
        if on.sum() < FEWEST:
            return None
    return plane if on.mean() >= MOSTLY else None


def _on_plane(plane: np.ndarray, u: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
    inverse = plane[0] * u + plane[1] * v + plane[2]
    there = (inverse > 1e-3) & (z > 0)
    return there & (np.abs(1 / np.where(there, inverse, 1.0) - z) <= np.maximum(NEAR_M, NEAR_SHARE * z))
