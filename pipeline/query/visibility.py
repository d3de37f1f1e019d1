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
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Int32, Int64
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, Rendering, render_reference, visible_ids
from pipeline.scene.gaussians import Gaussians


class VisibilityConfig(BaseModel):
    """How recorded views are rendered to see which Gaussians dominate (paper 3.1)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    long_side: int | None = Field(
        default=None,
        ge=1,
        description="Lossy: longest image side of the dominance renders, pixels. Null takes the recorded size.",
    )
    near_m: float = Field(default=0.2, gt=0, description="Near plane of the renders, metres.")


@dataclass(frozen=True, slots=True)
class VisibilityCounts:
    """How many Gaussians of each of L clusters dominate a pixel in each of N views."""

    visible: Int64[np.ndarray, "L N"]
    """|G_vis|."""
    sizes: Int64[np.ndarray, "L"]
    """|G_cluster|, at least 1."""

    @property
    def scores(self) -> Float[np.ndarray, "L N"]:
        """S_vis, 0 to 1."""
        return self.visible / self.sizes[:, None]


class VisibilityIndex:
    """Which Gaussians dominate a pixel of which recorded view: the sparse matrix D (N x M), built lazily by view.

    Args:
        gaussians: The scene.
        cameras: The N recorded cameras.
        config: Size and near plane of the renders.
    """

    def __init__(self, gaussians: PreparedGaussians, cameras: Sequence[Camera], config: VisibilityConfig) -> None:
        self._gaussians, self._count = gaussians, len(gaussians)
        self._near_m = config.near_m
        self._cameras = [fitted_to(camera, config.long_side) for camera in cameras]
        self._ids: list[Int32[np.ndarray, "_"] | None] = [None] * len(cameras)
        self._by_gaussian: Any = None

    def __len__(self) -> int:
        return len(self._cameras)

    @property
    def missing(self) -> int:
        """Views not rendered yet."""
        return sum(ids is None for ids in self._ids)

    @property
    def nbytes(self) -> int:
        """Size of the ids held, bytes."""
        return sum(ids.nbytes for ids in self._ids if ids is not None)

    def ids(self, view: int) -> Int32[np.ndarray, "_"]:
        """Return the sorted unique dominant ids of a view: row i of D."""
        found = self._ids[view]
        if found is None:
            found = np.asarray(visible_ids(self._gaussians, self._cameras[view], near=self._near_m), np.int32)
            self._ids[view] = found
        return found

    def adopt(self, view: int, ids: Int32[np.ndarray, "_"]) -> None:
        """Take over the ids of a view that another process rendered from the same scene with the same config."""
        if self._ids[view] is None:
            self._ids[view] = ids

    def build(self) -> None:
        """Render every view that was not rendered yet."""
        for view in range(len(self)):
            self.ids(view)

    def counts(self, clusters: Sequence[Int32[np.ndarray, "_"]]) -> VisibilityCounts:
        """Return |G_vis| of every cluster in every view, as the sparse product C^T D^T.

        The product reads only the rows of D^T that belong to a cluster, so its cost does not grow with the scene.

        Args:
            clusters: L sets of distinct Gaussian indices, each with at least one.
        """
        from scipy.sparse import csr_array

        sizes = np.array([len(cluster) for cluster in clusters], np.int64)
        if not len(clusters):
            return VisibilityCounts(np.zeros((0, len(self)), np.int64), sizes)
        members = np.concatenate(clusters)
        starts = np.concatenate([[0], np.cumsum(sizes)])
        chosen = csr_array((np.ones(len(members), np.int32), members, starts), shape=(len(clusters), self._count))
        return VisibilityCounts(np.asarray((chosen @ self._transposed()).toarray(), np.int64), sizes)

    def _transposed(self) -> Any:
        """D^T, M x N: for every Gaussian the views it dominates a pixel of."""
        if self._by_gaussian is None:
            from scipy.sparse import csr_array

            self.build()
            rows = [self.ids(view) for view in range(len(self))]
            starts = np.concatenate([[0], np.cumsum([len(row) for row in rows], dtype=np.int64)])
            indices = np.concatenate([np.empty(0, np.int32), *rows])
            shape = (len(self), self._count)
            matrix = csr_array((np.ones(len(indices), np.int32), indices, starts), shape=shape)
            self._by_gaussian = matrix.T.tocsr()
        return self._by_gaussian


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
