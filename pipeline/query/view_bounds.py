"""How much of a cluster a view can show at most, from projecting the cluster's Gaussians alone.

The members are projected by the renderer's own kernel, which gives each the rectangle of tiles that a render of the
full scene lists it in. So:

1. A Gaussian without a rectangle (outside the frustum, nearer than the near plane, below alpha 1/255 everywhere)
   dominates no pixel, and one with a rectangle dominates none outside of it.
2. A pixel has one dominant Gaussian, so no more Gaussians are visible than the tiles they touch have pixels.
3. Whether a Gaussian dominates a pixel of a rendered tile is known. With F the members found in rendered tiles and O
   the others whose rectangle has a tile that is not rendered, F <= G_vis <= F + O as sets; where O is empty, G_vis = F.

With weights instead of counts the same holds for sums, since weights are not negative; by 2 the sum of the O members
is at most that of the heaviest ones of them, as many as there are pixels left.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int32

from pipeline.query.visibility import LOOK_COST, TILE, SeenPart, VisibilityIndex, Window, summed
from pipeline.render.prepare import PreparedGaussians, take_rows

HAIR = 1e-9
"""Relative room that bounds of weighted sums get, for sums are rounded in another order; counts are exact."""

KEPT_FOOTPRINTS = 1 << 18
"""Footprints of a cluster that are kept (5 MB), so that most clusters are projected once a view, not at every look."""


@dataclass(frozen=True, slots=True)
class Footprints:
    """The members of a cluster that can touch a pixel of one view."""

    ids: Int32[np.ndarray, "n"]
    """Their indices in the scene, sorted."""
    tiles: Int32[np.ndarray, "n 4"]
    """First column, first row, last column, last row of the tiles each may touch; the last ones are not part."""


@dataclass(frozen=True, slots=True)
class Reach:
    """What projection alone says of a cluster in one view."""

    most: float
    """No less than what G_vis comes to, in Gaussians or weight."""
    window: Window
    """Tiles that hold all that its members may touch."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """What is known of how much of a cluster one view shows."""

    found: Int32[np.ndarray, "_"]
    """F: sorted members that dominate a pixel of a rendered tile."""
    most: float
    """No less than what G_vis comes to, in Gaussians or weight; exactly that where nothing is open."""
    open: Bool[np.ndarray, "rows columns"]
    """Tiles not rendered that a member of O may touch."""


class ClusterInViews:
    """One cluster against the views of an index.

    Args:
        index: The views, and what was rendered of them.
        cluster: Distinct indices of the members.
        weights: What the score counts instead of Gaussians, 0 or more; None counts them.
    """

    def __init__(
        self,
        index: VisibilityIndex,
        cluster: Int32[np.ndarray, "n"],
        weights: Float[np.ndarray, "M"] | None = None,
    ) -> None:
        self.index, self.weights = index, weights
        self.ids = np.sort(cluster)
        self._reach: dict[int, Reach | None] = {}
        self._kept: dict[int, Footprints] = {}
        self._room = KEPT_FOOTPRINTS

    @cached_property
    def _members(self) -> PreparedGaussians:
        return members_of(self.index.gaussians, self.index.places, self.ids)

    def reach(self, view: int) -> Reach | None:
        """Return what projection alone says of a view; None where the cluster cannot touch a pixel of it."""
        if view not in self._reach:
            self.index.work.searching += LOOK_COST
            footprints = self.footprints(view)
            self._reach[view] = None
            if len(footprints.ids):
                tiles = covered(footprints.tiles, self.index.tiles(view))
                self._reach[view] = Reach(self._at_most(footprints.ids, self._pixels(view, tiles)), hull(tiles))
        return self._reach[view]

    def amount(self, ids: Int32[np.ndarray, "n"]) -> float:
        """Return how much sorted Gaussians count."""
        return float(len(ids)) if self.weights is None else summed(self.weights[ids])

    def footprints(self, view: int) -> Footprints:
        """Return the members that can touch a pixel of a view, and where."""
        if view in self._kept:
            return self._kept[view]
        footprints = self._project(view)
        if len(footprints.ids) <= self._room:
            self._room -= len(footprints.ids)
            self._kept[view] = footprints
        return footprints

    def prospect(self, view: int) -> Prospect:
        """Return how much of the cluster a view shows at most, given what was rendered of it."""
        part, shape = self.index.part(view), self.index.tiles(view)
        found = np.intersect1d(part.ids, self.ids, assume_unique=True)
        if part.done.all():
            return Prospect(found, self.amount(found), np.zeros(shape, bool))
        footprints = self.footprints(view)
        is_open = ~np.isin(footprints.ids, found, assume_unique=True) & ~inside(footprints.tiles, part)
        touched = covered(footprints.tiles[is_open], shape) & ~part.done
        ids = footprints.ids[is_open]
        most = self.amount(found) + self._at_most(ids, self._pixels(view, touched))
        return Prospect(found, most, touched)

    def _project(self, view: int) -> Footprints:
        # The frame's phases, and numba with them, are imported at the first frame.
        from pipeline.render.culling import visible_blocks
        from pipeline.render.passes import Clock, sorted_records
        from pipeline.render.window import Window as Pixels

        camera, near = self.index.cameras[view], self.index.config.near_m
        whole = Pixels.of(camera)
        if not len(visible_blocks(self._members, self.index.lenses[view], whole, near)):
            return Footprints(np.empty(0, np.int32), np.empty((0, 4), np.int32))
        records = sorted_records(
            self._members,
            camera,
            whole,
            near=near,
            antialias=False,
            quality=self.index.quality,
            threads=1,
            clock=Clock(None, 1),
        )
        rows = (records.keys & np.uint64(0xFFFFFFFF)).astype(np.int64)
        ids = records.ids[rows]
        rows = rows[np.argsort(ids)]
        across, down = records.rectangles[2 * rows], records.rectangles[2 * rows + 1]
        tiles = np.stack([across & 0xFFFF, down & 0xFFFF, (across >> 16) + 1, (down >> 16) + 1], axis=1)
        return Footprints(records.ids[rows], tiles.astype(np.int32))

    def _at_most(self, ids: Int32[np.ndarray, "n"], pixels: int) -> float:
        """Amount of the members that can be visible in so many pixels."""
        if self.weights is None:
            return float(min(len(ids), pixels))
        weights = self.weights[ids]
        if pixels < len(ids):
            weights = np.partition(weights, len(ids) - pixels)[len(ids) - pixels :]
        return float(weights.sum()) * (1 + HAIR)

    def _pixels(self, view: int, tiles: Bool[np.ndarray, "rows columns"]) -> int:
        camera, (rows, columns) = self.index.cameras[view], tiles.shape
        heights = np.minimum(TILE, camera.height - TILE * np.arange(rows))
        widths = np.minimum(TILE, camera.width - TILE * np.arange(columns))
        return int(heights @ tiles.astype(np.int64) @ widths)


def members_of(
    prepared: PreparedGaussians, places: Int32[np.ndarray, "M"], ids: Int32[np.ndarray, "n"]
) -> PreparedGaussians:
    """Return some Gaussians of a prepared scene, with the bits they have there, ready to project.

    Args:
        prepared: The scene.
        places: Where each Gaussian lies in it, -1 for those that can never be seen.
        ids: The Gaussians.
    """
    rows = np.sort(places[ids]).astype(np.int64)
    return take_rows(prepared, rows[rows >= 0])


def inside(tiles: Int32[np.ndarray, "n 4"], part: SeenPart) -> Bool[np.ndarray, "n"]:
    """Return which rectangles of tiles were rendered whole."""
    sums = np.zeros((part.done.shape[0] + 1, part.done.shape[1] + 1), np.int64)
    sums[1:, 1:] = part.done.cumsum(axis=0).cumsum(axis=1)
    left, top, right, bottom = tiles.T
    done = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return np.asarray(done == (right - left) * (bottom - top))


def covered(tiles: Int32[np.ndarray, "n 4"], shape: tuple[int, int]) -> Bool[np.ndarray, "rows columns"]:
    """Return the union of rectangles of tiles."""
    left, top, right, bottom = tiles.T
    steps = np.zeros((shape[0] + 1, shape[1] + 1), np.int64)
    np.add.at(steps, (np.concatenate([top, bottom]), np.concatenate([left, right])), 1)
    np.add.at(steps, (np.concatenate([top, bottom]), np.concatenate([right, left])), -1)
    return np.asarray(steps.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0)


def hull(tiles: Bool[np.ndarray, "rows columns"]) -> Window:
    """Return the smallest window that holds these tiles; there is one at least."""
    rows, columns = np.flatnonzero(tiles.any(axis=1)), np.flatnonzero(tiles.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
