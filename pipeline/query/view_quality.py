"""How well a candidate view shows a cluster: measures that depend on its dominance and opacity images alone.

`footprint` reads a rendered view once; `view_quality` then serves every cluster that shares the view. What recorded
views have seen is counted by cells of space, not by Gaussian: on a surface that was seen well, many a Gaussian never
is the heaviest of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, Int64

from pipeline.geometry import Camera

SOLID_ALPHA = 0.5
"""Opacity from which a pixel shows a surface; the depth of fainter ones is mostly that of nothing."""
SEEN_CELL_M = 0.1
"""Side of the cells in which recorded views are counted: the scale of the smallest things that questions are about."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """Which Gaussians a view shows, and where in the image."""

    ids: Int32[np.ndarray, "n"]
    """Sorted distinct dominant Gaussians."""
    pixels: Int32[np.ndarray, "n"]
    """Pixels that each dominates, at least 1."""
    solid: Int32[np.ndarray, "n"]
    """Those of them with an opacity of at least `SOLID_ALPHA`."""
    sums: Float64[np.ndarray, "n 2"]
    """Sum of their pixel centres, column and row."""
    border: Bool[np.ndarray, "n"]
    """Whether one of them lies on the border of the image."""
    width: int
    """Image width, pixels."""
    height: int
    """Image height, pixels."""

    @property
    def nbytes(self) -> int:
        """Size of the arrays, bytes."""
        return sum(a.nbytes for a in (self.ids, self.pixels, self.solid, self.sums, self.border))


@dataclass(frozen=True, slots=True)
class ViewQuality:
    """Measures of one cluster in one view."""

    visibility: float
    """S_vis of the cluster from here at the pictures' size, 0 to 1; 0 for an empty cluster."""
    area: float
    """Share of pixels whose dominant Gaussian is in the cluster, 0 to 1."""
    centring: float
    """Distance of the centroid of those pixels from the image's centre: 0 there, 1 in a corner or without pixels."""
    truncation: float
    """Share of the cluster's centres that project outside the image or lie behind it, occluded or not; 0 for none."""
    touches_border: bool
    """Whether those pixels reach the border of the image."""
    new_gaussians: int
    """Gaussians of the cluster visible here and not in the initial view."""
    unobserved: float | None
    """Share of pixels that are less than half opaque or whose surface no recorded view saw; null when unknown."""
    floaters: float | None
    """Share of pixels whose surface one recorded view alone saw: as likely a floater as a thing; null when unknown."""


def footprint(
    dominant: Int32[np.ndarray, "H W"], alpha: Float[np.ndarray, "H W"] | Float32[np.ndarray, "H W"], count: int
) -> Footprint:
    """Return the footprint of a view.

    Args:
        dominant: Gaussian with the largest weight of each pixel, -1 for none.
        alpha: Opacity of each pixel, 0 to 1.
        count: M.
    """
    height, width = dominant.shape
    seen = np.zeros(count + 1, bool)  # marking is several times faster than sorting the pixels
    seen[dominant] = True  # -1 marks the last place, which is cut off
    ids = np.flatnonzero(seen[:-1]).astype(np.int32)
    place = np.full(count + 1, len(ids), np.int64)
    place[ids] = np.arange(len(ids))
    at = place[dominant]

    def per_gaussian(weights: np.ndarray | None) -> np.ndarray:
        flat = None if weights is None else np.broadcast_to(weights, at.shape).ravel()
        return np.bincount(at.ravel(), flat, len(ids) + 1)[:-1]

    edge = np.zeros(dominant.shape, bool)
    edge[[0, -1]] = edge[:, [0, -1]] = True
    columns, rows = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    return Footprint(
        ids,
        per_gaussian(None).astype(np.int32),
        per_gaussian(alpha >= SOLID_ALPHA).astype(np.int32),
        np.stack([per_gaussian(columns), per_gaussian(rows)], axis=1),
        np.isin(np.arange(len(ids)), at[edge]),
        width,
        height,
    )


def view_quality(
    view: Footprint,
    initial: Footprint,
    cluster: Int[np.ndarray, "_"],
    means: Float[np.ndarray, "M 3"] | Float32[np.ndarray, "M 3"],
    camera: Camera,
    times_seen: Int32[np.ndarray, "M"] | None,
) -> ViewQuality:
    """Return the measures of a cluster in a view.

    Args:
        view: The view's footprint.
        initial: That of the cluster's initial view; the view itself has nothing new.
        cluster: Distinct indices of the cluster's Gaussians.
        means: Centres of the scene's Gaussians, metres.
        camera: The view's lens and pose, of any image size.
        times_seen: From `times_seen`; None when it is not known.
    """
    total = view.width * view.height
    _, shown, _ = np.intersect1d(view.ids, cluster, assume_unique=True, return_indices=True)
    pixels = int(view.pixels[shown].sum())
    centring = 1.0
    if pixels:
        half = np.array([view.width, view.height]) / 2
        centring = float(np.linalg.norm(view.sums[shown].sum(axis=0) / pixels - half) / np.linalg.norm(half))
    unobserved = floaters = None
    if times_seen is not None:
        seen = times_seen[view.ids]
        unobserved = float(1 - view.solid[seen > 0].sum() / total)
        floaters = float(view.solid[seen == 1].sum() / total)
    return ViewQuality(
        visibility=len(shown) / max(1, len(cluster)),
        area=pixels / total,
        centring=centring,
        truncation=truncation(means[cluster], camera),
        touches_border=bool(view.border[shown].any()),
        new_gaussians=len(np.setdiff1d(view.ids[shown], initial.ids, assume_unique=True)),
        unobserved=unobserved,
        floaters=floaters,
    )


def truncation(points: Float[np.ndarray, "n 3"] | Float32[np.ndarray, "n 3"], camera: Camera) -> float:
    """Return the share of points that lie outside the image or behind the camera, whatever hides them; 0 for none."""
    if len(points) == 0:
        return 0.0
    pixels, _ = camera.project(points)
    inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)  # NaN, behind, is not inside
    return float(1 - inside.mean())


def times_seen(
    means: Float[np.ndarray, "M 3"] | Float32[np.ndarray, "M 3"],
    gaussians: Int[np.ndarray, "k"],
    views: Int[np.ndarray, "k"],
    cell_m: float = SEEN_CELL_M,
) -> Int32[np.ndarray, "M"]:
    """Return how many recorded views saw a Gaussian's cell: those in which a Gaussian of it dominates a pixel.

    Args:
        means: Centres, metres.
        gaussians: Gaussians that dominate a pixel of the recorded view in the same place of `views`.
        views: Numbers of those views, from 0.
        cell_m: Side of a cell, metres.
    """
    cell = cells_of(means, cell_m)
    count = int(views.max(initial=0)) + 1
    pairs = np.unique(cell[gaussians] * count + views)
    return np.bincount(pairs // count, minlength=len(means))[cell].astype(np.int32)


def cells_of(points: Float[np.ndarray, "n 3"] | Float32[np.ndarray, "n 3"], cell_m: float) -> Int64[np.ndarray, "n"]:
    """Return the number of the cubic cell each point lies in; cells are numbered from 0 without gaps."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    grid = np.floor(points / cell_m).astype(np.int64)
    grid -= grid.min(axis=0)
    sides = [int(side) + 1 for side in grid.max(axis=0)]
    # Far outliers could overflow one number per cell; they are as good in the last cell.
    sides = [min(side, 1 << 20) for side in sides]
    grid = np.minimum(grid, np.array(sides) - 1)
    flat = (grid[:, 0] * sides[1] + grid[:, 1]) * sides[2] + grid[:, 2]
    return np.unique(flat, return_inverse=True)[1].reshape(-1).astype(np.int64)
