"""Visibility scores S_vis of clusters in recorded views, from one dominance render per view (paper 3.1, DESIGN 4).

Let d_i(u) be the Gaussian with the largest weight at pixel u of view i in the full scene. A pixel whose dominant
Gaussian lies in a cluster shows positive activation when the cluster is rendered alone, because nothing left in front
of that Gaussian can take more light than before. So the paper's G_vis of cluster and view is exactly the set of unique
d_i(u) that lie in the cluster, and one render of each view serves every cluster of every question.
`literal_visible` writes the paper's formula out; a property test holds the two equal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, Int32, Int64
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry import Camera
from pipeline.query.transposed import Transposed
from pipeline.query.view_subset import spread_views
from pipeline.render import PreparedGaussians, Rendering, RenderQuality, render_many, render_reference, visible_ids
from pipeline.render.lens import Lens
from pipeline.scene.gaussians import Gaussians

TILE = 16
"""Side of the squares that a view may be rendered by, pixels: those of the renderer."""
Window = tuple[int, int, int, int]
"""First column, first row, last column, last row of tiles; the last ones are not part."""
WINDOW_COST = 1 / 6
"""Cost of any part of a view beside its pixels, as a share of the whole view's: projecting, and looking at bounds.
From 1/8 with 750,000 Gaussians to 1/6 with 60,000 (benchmarks/skips.py)."""
LOOK_COST = 1 / 150
"""Cost of projecting a cluster into a view, as a share of rendering it: 1/300 to 1/120."""
PARTS_SHARE = 0.5
"""A view whose parts would cost more than this share of it is rendered whole, so that many parts cost little more."""


class VisibilityConfig(BaseModel):
    """How recorded views are rendered to see which Gaussians dominate (paper 3.1)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    build: Literal["all", "auto", "lazy"] = Field(
        default="all",
        description="What is rendered before views are chosen; the choices are the same (docs/decisions/0006). all: "
        "every view of the scene, once. lazy: only tiles and views that may still hold the best view of a cluster: for "
        "a question or two a scene. auto: lazy while that has cost, and may cost for the next question, at most a "
        "quarter of all, then all; workers render all.",
    )
    near_m: float = Field(default=0.2, gt=0, description="Near plane of the renders, metres.")
    long_side: int | None = Field(
        default=None,
        ge=1,
        description="Lossy: longest image side of the dominance renders, pixels. Null takes the recorded size.",
    )
    exact_top: int = Field(
        default=0,
        ge=0,
        description="With long_side: how many of a cluster's best views at that size are scored again at the "
        "recorded size, which then decides. 0 for none.",
    )
    min_opacity: float = Field(default=0.0, ge=0, le=1, description="Lossy: less opaque Gaussians are left out.")
    every_nth: int = Field(default=1, ge=1, description="Lossy: only every n-th recorded view is used.")
    most_views: int | None = Field(
        default=None,
        ge=1,
        description="Lossy: most views used, those farthest apart in position and direction. Null for all.",
    )


PRESETS = {"exact": VisibilityConfig(), "fast": VisibilityConfig(long_side=320, exact_top=3)}
"""Settings by name. fast: 49 to 56 % of the time of the index, then 10 to 25 ms a cluster; the same view for 93 to 99 %
of the clusters, and 1.1 to 1.3 % less of them visible on average (benchmarks/view_policies.py). With more than some
dozens of clusters to score, exact is as fast."""


@dataclass(frozen=True, slots=True)
class VisibilityCounts:
    """How much of each of L clusters dominates a pixel in each of N views."""

    visible: Int64[np.ndarray, "L N"]
    """|G_vis|."""
    sizes: Int64[np.ndarray, "L"]
    """|G_cluster|, at least 1."""
    amounts: Float[np.ndarray, "L N"] | None = None
    """What the score counts instead of Gaussians: the sum of their weights over G_vis. None where it counts them."""
    totals: Float[np.ndarray, "L"] | None = None
    """The same sum over the cluster."""

    @property
    def scores(self) -> Float[np.ndarray, "L N"]:
        """S_vis, 0 to 1; 0 for a cluster without weight."""
        if self.amounts is None or self.totals is None:
            return self.visible / self.sizes[:, None]
        totals = self.totals[:, None]
        return np.divide(self.amounts, totals, out=np.zeros_like(self.amounts), where=totals > 0)


@dataclass(slots=True)
class VisibilityWork:
    """What an index has rendered so far."""

    frames: int = 0
    """Views rendered whole."""
    windows: int = 0
    """Parts of views."""
    tiles: int = 0
    """Tiles of 16 x 16 pixels in both."""
    searching: float = 0.0
    """About what the parts, and projecting clusters to bound what views show, cost: in renders of a whole view."""


@dataclass(frozen=True, slots=True)
class SeenPart:
    """What is known of a view that was rendered in part."""

    done: Bool[np.ndarray, "rows columns"]
    """Tiles that were rendered."""
    ids: Int32[np.ndarray, "_"]
    """Sorted Gaussians that dominate a pixel of one of them."""
    cost: float = 0.0
    """What rendering them cost, in whole views."""


class VisibilityIndex:
    """Which Gaussians dominate a pixel of which recorded view: the sparse matrix D (N x M), built lazily.

    Rows come whole (`ids`, `build`, `adopt`) or by tile (`show`): scores of all clusters need whole rows, the search
    for the best view of a few clusters (`view_search`) needs some tiles. Views that a policy leaves out see nothing.

    Args:
        gaussians: The scene.
        cameras: The N recorded cameras.
        config: Size and near plane of the renders, and which views are used.
    """

    def __init__(self, gaussians: PreparedGaussians, cameras: Sequence[Camera], config: VisibilityConfig) -> None:
        self.gaussians, self.config = gaussians, config
        self.cameras = tuple(fitted_to(camera, config.long_side) for camera in cameras)
        self.views = spread_views(self.cameras, config.every_nth, config.most_views)
        self.work = VisibilityWork()
        self.quality = RenderQuality(min_opacity=config.min_opacity)
        self._rows: list[Int32[np.ndarray, "_"] | None] = [np.empty(0, np.int32)] * len(cameras)
        for view in self.views:
            self._rows[view] = None
        self._parts: dict[int, SeenPart] = {}
        self._transposed: Transposed | None = None

    def __len__(self) -> int:
        return len(self.cameras)

    @property
    def missing(self) -> int:
        """Views whose rows are not known yet."""
        return 0 if self._transposed is not None else sum(row is None for row in self._rows)

    @cached_property
    def places(self) -> Int32[np.ndarray, "M"]:
        """Where each Gaussian lies among the prepared ones; -1 for those that can never be seen."""
        places = np.full(len(self.gaussians), -1, np.int32)
        kept = np.flatnonzero(self.gaussians.ids >= 0)
        places[self.gaussians.ids[kept]] = kept
        return places

    @cached_property
    def lenses(self) -> tuple[Lens, ...]:
        """The lens of each view."""
        return tuple(Lens.of(camera) for camera in self.cameras)

    @property
    def nbytes(self) -> int:
        """Size of the ids held, bytes."""
        parts = sum(part.ids.nbytes for part in self._parts.values())
        return parts + sum(row.nbytes for row in self._rows if row is not None)

    def ids(self, view: int) -> Int32[np.ndarray, "_"]:
        """Return the sorted unique dominant ids of a view: row i of D."""
        row = self._rows[view]
        if row is None and self._transposed is not None:
            places = np.flatnonzero(self._transposed.views == view)
            return (np.searchsorted(self._transposed.starts, places, side="right") - 1).astype(np.int32)
        if row is None:
            row = self._render(view)
            self._keep(view, row)
        return row

    def held(self, view: int) -> Int32[np.ndarray, "_"] | None:
        """Return row i of D where it is known whole; nothing is rendered."""
        return self._rows[view]

    def adopt(self, view: int, ids: Int32[np.ndarray, "_"]) -> None:
        """Take over the row of a view that another process rendered from the same scene with the same config."""
        if self._rows[view] is None:
            self._keep(view, ids)

    def adopt_transposed(self, joined: Transposed) -> None:
        """Take over the whole index from another process that rendered the same scene with the same config."""
        assert (joined.count, len(joined.starts)) == (len(self), len(self.gaussians) + 1)
        self._transposed = joined

    def build(self, threads: int = 1) -> None:
        """Render every view that is not known yet, `threads` of them side by side."""
        if not self.missing:
            return
        views = [view for view in self.views if self._rows[view] is None]
        images = render_many(
            self.gaussians,
            [self.cameras[view] for view in views],
            ("dominant",),
            threads=threads,
            near=self.config.near_m,
            quality=self.quality,
        )
        for view, image in zip(views, images, strict=True):
            assert image.dominant is not None
            self._count(view)
            self._keep(view, dominant_ids(image.dominant, len(self.gaussians)))

    def part(self, view: int) -> SeenPart:
        """Return what is known of a view."""
        row, shape = self._rows[view], self.tiles(view)
        if row is not None:
            return SeenPart(np.ones(shape, bool), row)
        return self._parts.get(view) or SeenPart(np.zeros(shape, bool), np.empty(0, np.int32))

    def show(self, view: int, window: Window) -> None:
        """Render some tiles of a view, or all of them where many parts of it were rendered before."""
        before = self.part(view)
        left, top, right, bottom = window
        done = before.done.copy()
        done[top:bottom, left:right] = True
        cost = before.cost + WINDOW_COST + (right - left) * (bottom - top) / done.size
        if done.all() or cost > PARTS_SHARE:
            self.ids(view)
        else:
            self._parts[view] = SeenPart(done, np.union1d(before.ids, self._render(view, window)), cost)

    def tiles(self, view: int) -> tuple[int, int]:
        """Return how many rows and columns of tiles a view has."""
        camera = self.cameras[view]
        return -(-camera.height // TILE), -(-camera.width // TILE)

    def counts(
        self, clusters: Sequence[Int32[np.ndarray, "_"]], weights: Float[np.ndarray, "M"] | None = None
    ) -> VisibilityCounts:
        """Return how much of every cluster is visible in every view: the sparse product C^T D^T.

        The product reads only the rows of D^T that belong to a cluster, so its cost does not grow with the scene.

        Args:
            clusters: L sets of distinct Gaussian indices, each with at least one.
            weights: What the score counts instead of Gaussians; None counts them.
        """
        joined = self.joined()
        visible, sizes = joined.counts(clusters), np.array([len(cluster) for cluster in clusters], np.int64)
        if weights is None:
            return VisibilityCounts(visible, sizes)
        amounts = [_amounts(joined, cluster, weights) for cluster in clusters]
        totals = np.array([summed(weights[np.sort(cluster)]) for cluster in clusters], np.float64)
        return VisibilityCounts(visible, sizes, np.array(amounts).reshape(visible.shape), totals)

    def joined(self) -> Transposed:
        """Return D^T, made when it is first asked for; views that are not known yet are rendered."""
        if self._transposed is None:
            self.build()
            self._transposed = Transposed.of([self.ids(view) for view in range(len(self))], len(self.gaussians))
        return self._transposed

    def _render(self, view: int, window: Window | None = None) -> Int32[np.ndarray, "_"]:
        self._count(view, window)
        return visible_ids(
            self.gaussians, self.cameras[view], near=self.config.near_m, quality=self.quality, window=window
        )

    def _count(self, view: int, window: Window | None = None) -> None:
        rows, columns = self.tiles(view)
        left, top, right, bottom = window or (0, 0, columns, rows)
        tiles = (right - left) * (bottom - top)
        self.work.tiles += tiles
        if window is None:
            self.work.frames += 1
        else:
            self.work.windows += 1
            self.work.searching += WINDOW_COST + tiles / (rows * columns)

    def _keep(self, view: int, ids: Int32[np.ndarray, "_"]) -> None:
        self._rows[view] = ids
        self._parts.pop(view, None)


def summed(weights: Float[np.ndarray, "n"]) -> float:
    """Return the sum of weights, added one after another: equal sets give equal bits, however they were found."""
    return float(np.cumsum(weights)[-1]) if len(weights) else 0.0


def _amounts(
    joined: Transposed, cluster: Int32[np.ndarray, "n"], weights: Float[np.ndarray, "M"]
) -> Float[np.ndarray, "N"]:
    """Sum of weights over G_vis in every view; `bincount` adds in the order of the members, as `summed` does."""
    members = np.sort(cluster)
    lengths = joined.starts[members + 1] - joined.starts[members]
    rows = [joined.views[joined.starts[member] : joined.starts[member + 1]] for member in members]
    views = np.concatenate([np.empty(0, np.int64), *rows]).astype(np.int64)
    return np.bincount(views, np.repeat(weights[members], lengths), minlength=joined.count).astype(np.float64)


def dominant_ids(dominant: Int32[np.ndarray, "H W"], count: int) -> Int32[np.ndarray, "_"]:
    """Return the sorted distinct ids of a dominance image of M = `count` Gaussians, without the -1 of empty pixels."""
    seen = np.zeros(count + 1, bool)  # marking is several times faster than sorting the pixels
    seen[dominant] = True  # -1 marks the last place, which is cut off
    return np.flatnonzero(seen[:-1]).astype(np.int32)


def fitted_to(camera: Camera, long_side: int | None) -> Camera:
    """Return the camera with its longer side reduced to `long_side` pixels; never enlarged."""
    longest = max(camera.width, camera.height)
    if long_side is None or longest <= long_side:
        return camera
    width, height = (max(1, round(side * long_side / longest)) for side in (camera.width, camera.height))
    return camera.resized(width, height)


def literal_visible(
    gaussians: Gaussians,
    cluster: Int[np.ndarray, "n"],
    camera: Camera,
    *,
    near_m: float = 0.2,
    renderer: Callable[..., Rendering] = render_reference,
) -> Int64[np.ndarray, "_"]:
    """Return G_vis of one cluster and view by the paper's formula, with the float64 reference: slow and obvious.

    Args:
        gaussians: The full scene.
        cluster: Indices of the cluster's Gaussians.
        camera: The view H_i.
        near_m: Near plane, metres.
        renderer: What renders, `render_reference` or `render`.

    Returns:
        Sorted indices of the cluster's Gaussians that are visible.
    """
    alone = renderer(gaussians.take(np.asarray(cluster)), camera, outputs=("alpha",), near=near_m)
    full = renderer(gaussians, camera, outputs=("dominant",), near=near_m)
    assert alone.alpha is not None
    assert full.dominant is not None
    activated_pixels = alone.alpha > 0  # M_visible: pixels with positive activation
    dominant = np.unique(full.dominant[activated_pixels])  # G_max
    return np.intersect1d(dominant[dominant >= 0], cluster).astype(np.int64)
