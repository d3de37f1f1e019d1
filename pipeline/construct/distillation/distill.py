"""Ground truth on Gaussians: labels of a point cloud or mesh, voted onto each Gaussian by Mahalanobis distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, Int64
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry.quaternion import quats_to_rotations
from pipeline.render.threads import run_each
from pipeline.scene import Gaussians
from pipeline.scene.semantics import UNLABELLED
from schemas.errors import InputError

CHUNK = 1 << 14
"""Gaussians a thread takes at once: 1.2 MB of rotations, and pieces enough to share out."""
LEAF = 16
"""Points a leaf holds at most: two or three cache lines of each array."""
CELLS = 128
"""Cells along the points' longest side. Gaussians are visited cell by cell: neighbours read the same points, which
takes a third off the time of a scene in random order."""
FLATTEST_M = 1e-6
"""Least standard deviation along an axis: a flat Gaussian has no Mahalanobis distance, one of a micrometre does."""


class DistillConfig(BaseModel):
    """Which points count for a Gaussian; the defaults are those of the method the paper follows."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    reach: float = Field(
        default=5.0, gt=0, allow_inf_nan=False, description="Candidates lie within this many times the largest scale."
    )
    most: int = Field(default=1000, ge=1, description="Nearest candidates that count.")
    farthest: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Mahalanobis distance of the nearest candidate beyond which a Gaussian stays unlabelled; "
        "without it, any candidate labels.",
    )


@dataclass(frozen=True, slots=True)
class Distilled:
    """What the points say of each of M Gaussians."""

    label: Int32[np.ndarray, "M"]
    """Label with the largest summed weight, the lowest of those tied; -1 unlabelled: to be ignored, no background."""
    purity: Float32[np.ndarray, "M"]
    """Share of the winning label (unlabelled points are one, too) in the summed weight, 0 to 1; 0: no candidate."""
    nearest: Float32[np.ndarray, "M"]
    """Least Mahalanobis distance of a candidate; infinite where there is none."""
    candidates: Int32[np.ndarray, "M"]
    """Points that counted."""


def distill(
    gaussians: Gaussians,
    points: Float[np.ndarray, "P 3"],
    labels: Int32[np.ndarray, "P"],
    config: DistillConfig | None = None,
    *,
    threads: int = 1,
) -> Distilled:
    """Return the label of every Gaussian (paper, supplement "Dataset Construction").

    A Gaussian's candidates are the nearest points within a multiple of its largest scale. Each weighs exp(-d^2 / 2),
    d its Mahalanobis distance; weights are summed by label and the largest sum wins. Points labelled -1 vote as well,
    as one label: a Gaussian on a surface nobody annotated is not given to a thing beside it.

    Exact: candidates at the same distance rank by index, labels within 1e-9 of the best are tied. Memory beyond the
    input is 50 bytes a point and 80 a Gaussian.

    Args:
        gaussians: M Gaussians.
        points: P points in the Gaussians' own coordinates (ScanNet: unaligned), metres, finite.
        labels: Category or instance of each point, -1 unlabelled.
        config: Which points count.
        threads: Chunks of Gaussians side by side; no number of them changes a result.

    Raises:
        InputError: There is no point, one is not finite, or a label is under -1.
    """
    config = config or DistillConfig()
    _check(points, labels)
    # Compiled code is loaded when there is work, not on import.
    from pipeline.construct.distillation.distill_kernels import vote

    names, index = np.unique(labels, return_inverse=True)
    tree = _Tree.of(points, index.astype(np.int32))
    count = len(gaussians)
    winner, candidates = np.empty(count, np.int32), np.empty(count, np.int32)
    purity, nearest = np.empty(count, np.float32), np.empty(count, np.float32)
    visits = _cell_by_cell(gaussians.means, tree)

    def work(chunk: int) -> None:
        ids = visits[chunk * CHUNK : (chunk + 1) * CHUNK]
        scales = np.exp(gaussians.log_scales[ids].astype(np.float64))
        axes = np.swapaxes(quats_to_rotations(gaussians.quats[ids]), 1, 2)
        out = (np.empty(len(ids), np.int32), *np.empty((2, len(ids)), np.float32), np.empty(len(ids), np.int32))
        vote(
            tree.points,
            tree.order,
            tree.labels,
            tree.low,
            tree.high,
            tree.levels,
            len(names),
            gaussians.means[ids].astype(np.float64),
            np.ascontiguousarray(axes / np.maximum(scales, FLATTEST_M)[:, :, None]),
            config.reach * scales.max(axis=1),
            min(config.most, len(points)),
            *out,
        )
        winner[ids], purity[ids], nearest[ids], candidates[ids] = out

    run_each(work, -(-count // CHUNK), threads)
    far = candidates == 0 if config.farthest is None else nearest > config.farthest
    label = names.astype(np.int32)[winner]
    label[far] = UNLABELLED
    return Distilled(label, purity, nearest, candidates)


@dataclass(frozen=True, slots=True)
class _Tree:
    """Points in the order of a k-d tree whose node k has the children 2k + 1 and 2k + 2."""

    points: Float64[np.ndarray, "P 3"]
    order: Int32[np.ndarray, "P"]
    """Index of each point in the input."""
    labels: Int32[np.ndarray, "P"]
    low: Float64[np.ndarray, "K 3"]
    high: Float64[np.ndarray, "K 3"]
    levels: int

    @classmethod
    def of(cls, points: Float[np.ndarray, "P 3"], labels: Int32[np.ndarray, "P"]) -> _Tree:
        from pipeline.construct.distillation.distill_kernels import build_tree

        levels = max(0, (len(points) - 1) // LEAF).bit_length()
        nodes = (2 << levels) - 1
        low, high = np.empty((nodes, 3)), np.empty((nodes, 3))
        sorted_points, order = np.array(points, np.float64, order="C"), np.arange(len(points), dtype=np.int32)
        build_tree(sorted_points, order, levels, low, high)
        return cls(sorted_points, order, labels[order], low, high, levels)


def _cell_by_cell(means: Float32[np.ndarray, "M 3"], tree: _Tree) -> Int64[np.ndarray, "M"]:
    low, high = tree.low[0], tree.high[0]
    side = max(float((high - low).max()) / CELLS, FLATTEST_M)
    cells = np.clip((means - low) // side, -1, CELLS).astype(np.int64) + 1
    return np.argsort(cells @ np.array([(CELLS + 2) ** 2, CELLS + 2, 1]), kind="stable")


def _check(points: Float[np.ndarray, "P 3"], labels: Int32[np.ndarray, "P"]) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or not 0 < len(points) < 1 << 31:
        raise InputError("points", expected="(P, 3) coordinates of at least one point", found=points.shape)
    if labels.shape != (len(points),):
        raise InputError("labels", expected=f"{len(points)}, one a point", found=labels.shape)
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputError("points", field=f"point {row}", expected="finite coordinates", found=points[row].tolist())
    if labels.min() < UNLABELLED:
        raise InputError("labels", expected="ids from 0, or -1 for unlabelled", found=int(labels.min()))
