"""What a good view of a cluster is: the score that `explore` gives to a coarse render.

The cluster and what is near to it are divided into patches, cells of space that hold some of its Gaussians. Patches
count the same however densely a surface was sampled and however coarse the render is; visible Gaussians do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32

from pipeline.geometry import Camera
from pipeline.query.explore_config import ExploreWeights
from pipeline.query.view_quality import cells_of, truncation

PATCH_M = 0.05
"""Smallest patch of a cluster, metres; patches grow until there are at most `MOST_PATCHES`."""
MOST_PATCHES = 200
"""Patches of a cluster, at most: half a percent of it each."""
AROUND_M = 0.15
"""Patch of the surroundings, metres: a thing that stands there has a few."""
NEAR_M = 0.5
"""Surfaces nearer than this crowd the image."""
SMALL_AREA, GOOD_AREA = 0.003, 0.06
"""Shares of the image: a cluster of the former is hard to recognise, more than the latter adds little."""


@dataclass(frozen=True, slots=True)
class Target:
    """What to look at."""

    patch: Int32[np.ndarray, "_"]
    """Patch of every Gaussian: those of the cluster first, then those around it; -1 for all else and in last place."""
    patches: int
    """Patches of the cluster, at least 1."""
    around: int
    """Patches around it."""
    points: Float64[np.ndarray, "patches 3"]
    """Mean of the centres in each patch of the cluster, metres."""

    @property
    def middle(self) -> Float64[np.ndarray, "3"]:
        """Mean of the patches."""
        return self.points.mean(axis=0)

    @property
    def radius_m(self) -> float:
        """Root mean square distance of the patches from the middle."""
        return float(np.sqrt(((self.points - self.middle) ** 2).sum(axis=1).mean()))


@dataclass(frozen=True, slots=True)
class Sight:
    """What a coarse render shows of a target; shares are of the image's pixels."""

    seen: Bool[np.ndarray, "_"]
    """Patches of which a Gaussian dominates a pixel."""
    area: float
    """Share of the cluster."""
    truncation: float
    """Share of the cluster's patches outside the image."""
    centring: float
    """Distance of the cluster's pixels from the centre: 0 there, 1 in a corner or without pixels."""
    unobserved: float
    """Share that is empty or shows a surface that no recorded view saw."""
    near: float
    """Share nearer than `NEAR_M`."""


def make_target(
    means: Float[np.ndarray, "M 3"] | Float32[np.ndarray, "M 3"], cluster: Int[np.ndarray, "n"], surroundings_m: float
) -> Target:
    """Return the patches of a cluster of at least one Gaussian and of what lies in its box, widened on all sides.

    Args:
        means: Centres of the scene's Gaussians, metres.
        cluster: Distinct indices.
        surroundings_m: By how much the box is widened.
    """
    own = means[cluster].astype(np.float64)
    size = PATCH_M
    cells = cells_of(own, size)
    while cells.max() >= MOST_PATCHES:
        size *= 1.3
        cells = cells_of(own, size)
    count = int(cells.max()) + 1
    sums = np.stack([np.bincount(cells, own[:, axis]) for axis in range(3)], axis=1)
    points = sums / np.bincount(cells)[:, None]
    patch = np.full(len(means) + 1, -1, np.int32)
    low, high = (np.float32(end) for end in (own.min(axis=0) - surroundings_m, own.max(axis=0) + surroundings_m))
    near = np.flatnonzero(((means >= low) & (means <= high)).all(axis=1))
    near = np.setdiff1d(near, cluster, assume_unique=True) if surroundings_m > 0 else near[:0]
    others = cells_of(means[near].astype(np.float64), AROUND_M)
    patch[near] = count + others
    patch[cluster] = cells
    return Target(patch, count, int(others.max(initial=-1)) + 1, points)


def look(
    dominant: Int32[np.ndarray, "H W"],
    camera: Camera,
    target: Target,
    means: Float[np.ndarray, "M 3"] | Float32[np.ndarray, "M 3"],
    times_seen: Int32[np.ndarray, "M"],
) -> Sight:
    """Return what a dominance image shows of a target.

    Args:
        dominant: Gaussian with the largest weight of each pixel, -1 for none.
        camera: Of the image's size.
        target: What to look at.
        means: Centres of the scene's Gaussians, metres: how near a surface is.
        times_seen: How many recorded views saw the place of each Gaussian.
    """
    patch = target.patch[dominant]
    seen = np.zeros(target.patches + target.around + 1, bool)
    seen[patch] = True
    own = (patch >= 0) & (patch < target.patches)
    rows, columns = np.nonzero(own)
    centring = 1.0
    if len(rows):
        half = np.array([camera.width, camera.height]) / 2
        offset = np.array([columns.mean() + 0.5, rows.mean() + 0.5]) - half
        centring = float(np.linalg.norm(offset) / np.linalg.norm(half))
    shown = dominant[dominant >= 0]
    depth = means[shown] @ camera.world_to_camera[2, :3].astype(means.dtype) + camera.world_to_camera[2, 3]
    return Sight(
        seen[:-1],
        len(rows) / dominant.size,
        truncation(target.points, camera),
        centring,
        1 - int((times_seen[shown] > 0).sum()) / dominant.size,
        int((depth < NEAR_M).sum()) / dominant.size,
    )


def score(sight: Sight, target: Target, covered: Bool[np.ndarray, "_"], weights: ExploreWeights) -> float:
    """Return how much a view adds to those that show `covered` already; higher is better.

    The terms, with their weights: new patches of the cluster (1), new patches around it (`weights.around`), its size
    in the image on a logarithmic scale, its place in the image, and, against the view, what the frame cuts off, what
    no recorded view saw, and what stands right before the camera.
    """
    new = sight.seen & ~covered
    cover = new[: target.patches].mean()
    around = new[target.patches :].mean() if target.around else 0.0
    size = np.log(max(sight.area, 1e-9) / SMALL_AREA) / np.log(GOOD_AREA / SMALL_AREA)
    return float(
        cover
        + weights.around * around
        + weights.size * np.clip(size, 0, 1)
        - weights.centring * sight.centring
        - weights.truncation * sight.truncation
        - weights.unobserved * sight.unobserved
        - weights.near * sight.near
    )
