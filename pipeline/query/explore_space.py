"""Where a camera may stand in a scene: cells that no surface comes near and that the recorded cameras connect to.

Cells are grouped by flooding from the recorded camera centres, which are free by construction. So no place inside
furniture, behind a wall or outside the building is reached, whatever the scene looks like from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from pipeline.geometry.quaternion import quats_to_rotations
from pipeline.query.explore_config import ExploreConfig
from pipeline.scene.gaussians import Gaussians

MOST_CELLS = 8_000_000
"""Cells grow where a scene would need more than these: a megabyte each million."""
BEYOND_M = 2.0
"""The map goes this far beyond where cameras may stand: what hides things from them is mostly near to either."""
SURFACE_LOGIT = 0.0
"""Opacity logit from which a Gaussian stands in the way: a half opaque one."""
SPREAD = 1.5
"""Standard deviations over which a Gaussian blocks cells: there it still has a third of its opacity."""
MOST_SPREAD = 16
"""Cells that a Gaussian blocks to each side of its centre along an axis, at most."""


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """A grid of cells over the places that recorded cameras were near to."""

    origin: Float64[np.ndarray, "3"]
    """Corner of cell (0, 0, 0), metres."""
    cell_m: float
    """Side of a cell, metres."""
    blocked: Bool[np.ndarray, "I J K"]
    """Cells that a surface goes through."""
    free: Bool[np.ndarray, "I J K"]
    """Cells where a camera may stand."""
    stands: Float64[np.ndarray, "n 3"]
    """Places where a camera may stand, metres: recorded centres first, then middles of free cells."""

    def allows(self, places: Float64[np.ndarray, "k 3"]) -> Bool[np.ndarray, "k"]:
        """Return which places lie in a cell where a camera may stand."""
        cells = np.floor((places - self.origin) / self.cell_m).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.free.shape)).all(axis=1)
        return inside & self.free[tuple(np.where(inside[:, None], cells, 0).T)]

    def sees(self, eyes: Float64[np.ndarray, "E 3"], points: Float64[np.ndarray, "P 3"]) -> Bool[np.ndarray, "E P"]:
        """Return which points can be seen from which places, but for what is within two cells of a point."""
        from pipeline.query.explore_kernels import sight_lines

        return np.asarray(sight_lines(self.blocked, self.origin, self.cell_m, eyes, points, 2.0 * self.cell_m))


def map_space(
    gaussians: Gaussians, centers: Float64[np.ndarray, "N 3"], up: Float[np.ndarray, "3"], config: ExploreConfig
) -> FreeSpace:
    """Return the free space around recorded cameras.

    Args:
        gaussians: The scene.
        centers: Centres of the recorded cameras, metres, at least one.
        up: Unit vector opposite to gravity.
        config: Clearance, reach and heights.
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    margin = config.reach_m + BEYOND_M
    low, high = centers.min(axis=0) - margin, centers.max(axis=0) + margin
    cell_m = max(config.cell_m, float(np.prod(high - low) / MOST_CELLS) ** (1 / 3))
    shape = tuple(int(n) for n in np.ceil((high - low) / cell_m))
    blocked = np.zeros(shape, bool)
    for points in _surface_points(gaussians, low, high, cell_m):
        cells = np.floor((points - low) / cell_m).astype(np.int64)
        cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
        blocked[tuple(cells.T)] = True

    near = cKDTree(centers)
    reach = int(np.ceil(config.clearance_m / cell_m))
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1)
    ball = np.linalg.norm(offsets, axis=-1) * cell_m <= config.clearance_m
    free = ~ndimage.binary_dilation(blocked, ball)
    heights = centers @ up
    lowest, highest = heights.min() - config.height_margin_m, heights.max() + config.height_margin_m
    middle = low + (np.argwhere(free) + 0.5) * cell_m
    reached = (middle @ up >= lowest) & (middle @ up <= highest)
    reached[reached] = near.query(middle[reached])[0] <= config.reach_m
    free[tuple(np.argwhere(free)[~reached].T)] = False
    groups, _ = ndimage.label(free)
    own = np.floor((centers - low) / cell_m).astype(np.int64)
    # A recorded camera may stand nearer to a surface than the clearance: its neighbours connect it then.
    around = np.concatenate([own + step for step in np.ndindex(3, 3, 3)]) - 1
    around = np.clip(around, 0, np.array(shape) - 1)
    connected = np.unique(groups[tuple(around.T)])
    free = np.isin(groups, connected[connected > 0])
    middles = low + (np.argwhere(free) + 0.5) * cell_m
    return FreeSpace(low, cell_m, blocked, free, np.concatenate([centers, middles]))


def _surface_points(
    gaussians: Gaussians, low: Float64[np.ndarray, "3"], high: Float64[np.ndarray, "3"], cell_m: float
) -> Iterator[Float64[np.ndarray, "_ 3"]]:
    """Yield points about a cell apart on every half opaque Gaussian whose centre lies in a box."""
    inside = ((gaussians.means >= low) & (gaussians.means <= high)).all(axis=1)
    solid = np.flatnonzero(inside & (gaussians.opacity_logits >= SURFACE_LOGIT))
    means = gaussians.means[solid].astype(np.float64)
    half = SPREAD * np.exp(gaussians.log_scales[solid].astype(np.float64))
    # Steps to each side are rounded up to a power of two: that leaves few kinds of Gaussians to go through.
    steps = 2.0 ** np.ceil(np.log2(np.clip(half / cell_m, 0.5, MOST_SPREAD)))
    kinds, kind = np.unique(np.where(half < cell_m / 2, 0, steps).astype(np.int64), axis=0, return_inverse=True)
    for number, sides in enumerate(kinds):
        members = np.flatnonzero(kind.reshape(-1) == number)
        if not sides.any():
            yield means[members]
            continue
        axes = quats_to_rotations(gaussians.quats[solid[members]]) * half[members][:, None, :]
        for offset in _lattice(sides):
            yield means[members] + axes @ offset


def _lattice(steps: Int64[np.ndarray, "3"]) -> Float64[np.ndarray, "_ 3"]:
    """Points from -1 to 1 along each axis with steps, 0 along the others."""
    sides = [np.linspace(-1, 1, 2 * int(n) + 1) if n else np.zeros(1) for n in steps]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
