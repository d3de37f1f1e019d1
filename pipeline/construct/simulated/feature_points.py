"""Sparse points of known frames: those structure from motion would have found, with its gaps and its noise.

Corners of the photographs (Shi and Tomasi 1994) that enough photographs see from far enough apart. They lie where
photographs have texture, as those of a reconstruction do; bare walls have none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64, UInt8

from pipeline.geometry import Camera
from pipeline.scene.captures import SparsePoints
from schemas.errors import InputError

CORNERS = 2000
"""Corners looked for in a photograph."""
CORNER_SHARE = 1e-4
"""Of the strongest corner's strength, what one needs at least: generated photographs have no noise, so that weak ones
are found again, where photographs of real rooms have texture instead."""
CORNER_SIGMA_PX = 1.5
"""Window over which gradients are summed."""
CORNER_REACH_PX = 5
"""Side of the window in which a corner is the strongest."""
FLAT_SHARE = 0.03
"""Relative range of depth around a corner above which it is a silhouette and no place in the world."""
SAME_SHARE = 0.02
"""Relative difference of depth up to which another photograph sees the same point."""
LEAST_VIEWS = 3
LEAST_PARALLAX_RAD = float(np.deg2rad(1.5))
"""Angle between the rays below which points are dropped (COLMAP)."""
CORNER_NOISE_PX = 0.5
"""Deviation of a corner's place in a photograph."""
VOXEL_M = 0.02
"""Corners of the same voxel are one point: matching would have joined them."""


@dataclass(frozen=True, slots=True)
class KnownFrame:
    """A photograph whose true depth is known."""

    photo: UInt8[np.ndarray, "H W 3"]
    """sRGB."""
    depth_m: Float32[np.ndarray, "H W"]
    """True z-depth, metres, 0 where there is nothing."""
    camera: Camera
    """Lens and pose of both."""


def feature_points(frames: Sequence[KnownFrame], rng: np.random.Generator) -> SparsePoints:
    """Return the points that photographs would have been found to share.

    A point's place is off along its first ray by (pixel noise / parallax) and across by the pixel noise, both less the
    more photographs see it.

    Args:
        frames: Photographs with true depth.
        rng: Source of the noise.

    Raises:
        InputError: No point is seen from enough places.
    """
    places, colors, origins = _corners(frames)
    _, first = np.unique(np.floor(places / VOXEL_M), axis=0, return_index=True)
    first.sort()
    places, colors, origins = places[first], colors[first], origins[first]
    rays = places - origins
    distance = np.linalg.norm(rays, axis=1)
    rays /= distance[:, None]
    views, parallax = np.zeros(len(places), np.int64), np.zeros(len(places))
    for frame in frames:
        seen = _seen(frame, places)
        other = places[seen] - frame.camera.center
        cosine = (rays[seen] * other).sum(axis=1) / np.linalg.norm(other, axis=1)
        views[seen] += 1
        parallax[seen] = np.maximum(parallax[seen], np.arccos(np.clip(cosine, -1.0, 1.0)))
    kept = np.flatnonzero((views >= LEAST_VIEWS) & (parallax >= LEAST_PARALLAX_RAD))
    if not len(kept):
        raise InputError("sparse points", expected=f"corners that {LEAST_VIEWS} photographs share", found="none")
    across = CORNER_NOISE_PX / frames[0].camera.K[0, 0] * distance[kept] / np.sqrt(views[kept])
    along = across / parallax[kept]
    noise = rng.normal(0.0, 1.0, (len(kept), 3)) * across[:, None]
    noise += rays[kept] * (rng.normal(0.0, 1.0, len(kept)) * along)[:, None]
    return SparsePoints(places[kept] + noise, colors[kept])


def _corners(
    frames: Sequence[KnownFrame],
) -> tuple[Float64[np.ndarray, "C 3"], UInt8[np.ndarray, "C 3"], Float64[np.ndarray, "C 3"]]:
    """Return place and colour of the corners of all photographs, and the centre of the camera that saw each."""
    places, colors, origins = [], [], []
    for frame in frames:
        rows, columns = _strongest(frame).T
        local = frame.camera.unproject(frame.depth_m)[rows, columns]
        pose = frame.camera.camera_to_world
        places.append(local @ pose[:, :3].T + pose[:, 3])
        colors.append(frame.photo[rows, columns])
        origins.append(np.broadcast_to(frame.camera.center, (len(rows), 3)))
    return np.concatenate(places), np.concatenate(colors), np.concatenate(origins)


def _strongest(frame: KnownFrame) -> Int64[np.ndarray, "C 2"]:
    """Return rows and columns of a photograph's corners, the strongest first."""
    from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter, sobel

    grey = frame.photo.astype(np.float64).mean(axis=2)
    by_row, by_column = sobel(grey, 0), sobel(grey, 1)
    rr, cc, rc = (
        gaussian_filter(product, CORNER_SIGMA_PX) for product in (by_row**2, by_column**2, by_row * by_column)
    )
    strength: Float[np.ndarray, "H W"] = (rr + cc - np.sqrt((rr - cc) ** 2 + 4 * rc**2)) / 2
    low, high = minimum_filter(frame.depth_m, 3), maximum_filter(frame.depth_m, 3)
    good = (low > 0) & (high - low <= FLAT_SHARE * low) & (strength > CORNER_SHARE * strength.max())
    good &= strength == maximum_filter(strength, CORNER_REACH_PX)
    found = np.argwhere(good)
    return found[np.argsort(-strength[good], kind="stable")[:CORNERS]]


def _seen(frame: KnownFrame, places: Float64[np.ndarray, "C 3"]) -> Int64[np.ndarray, "S"]:
    """Return the numbers of the points a frame sees, by its true depth."""
    camera = frame.camera
    pixels, depth = camera.project(places)
    with np.errstate(invalid="ignore"):
        inside = np.flatnonzero((depth > 0) & ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1))
    columns, rows = pixels[inside].astype(int).T
    return inside[np.abs(frame.depth_m[rows, columns] - depth[inside]) <= SAME_SHARE * depth[inside]]
