"""Connected parts of a category image, cut where depth jumps.

Rows are first cut into runs of one category at one surface; runs that touch in neighbouring rows join. A part is a
patch of one category on one surface: an object that something stands before may show several (see `merge.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Int32, Int64

JUMP_M = 0.06
"""Depth step between neighbouring pixels that separates two surfaces: about the thickness of a chair back."""
JUMP_PER_M = 0.02
"""Added per metre of depth: depth is less certain farther off."""
BEND = 0.012
"""Largest bend, as a share of inverse depth, of what counts as one plane: a table top seen at a low angle falls away
by more than a jump from pixel to pixel, but the inverse depth of a plane is straight."""
SAMPLES = 192
"""Pixels sampled per part for positions and colours: percentiles of a part are then good to about 2 %."""


@dataclass(frozen=True, slots=True)
class Parts:
    """P parts, largest first."""

    labels: Int32[np.ndarray, "H W"]
    """Part per pixel, -1 where there is none or one too small to count."""
    category: Int64[np.ndarray, "P"]
    """Category id of each."""
    pixels: Int64[np.ndarray, "P"]
    """Area of each."""
    bounds: Int64[np.ndarray, "P 4"]
    """First and last column and row of each: left, top, right, bottom."""
    sample_pixel: Int64[np.ndarray, "S"]
    """Flat indices of sampled pixels, spread evenly over each part."""
    sample_part: Int64[np.ndarray, "S"]
    """Part of each sample, ascending."""


def jump_limit(depth_m: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return the depth step (metres) above which neighbours at this depth lie on different surfaces."""
    return np.asarray(JUMP_M + JUMP_PER_M * depth_m)


def find_parts(category: Int[np.ndarray, "H W"], depth_m: Float[np.ndarray, "H W"], min_pixels: int) -> Parts:
    """Return the parts of a view.

    Args:
        category: Category id per pixel, below 0 where there is none.
        depth_m: z-depth, metres; pixels at 0 belong to no part.
        min_pixels: Smaller parts are left out.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    height, width = category.shape
    depth = np.asarray(depth_m, np.float32)
    category = np.where(depth > 0, category, -1)
    starts = np.ones((height, width), bool)
    starts[:, 1:] = ~(_continues(depth.T).T & (category[:, 1:] == category[:, :-1]))
    run_start = np.flatnonzero(starts)
    run = (np.cumsum(starts) - 1).reshape(height, width)
    joined = _continues(depth) & (category[1:] == category[:-1]) & (category[1:] >= 0)
    upper, lower = _touching_runs(run, joined, starts)
    graph = coo_array((np.ones(len(upper), np.int8), (upper, lower)), shape=(len(run_start), len(run_start)))
    count, run_part = connected_components(graph, directed=False)

    length = np.diff(np.append(run_start, height * width))
    area = np.bincount(run_part, weights=length, minlength=count).astype(np.int64)
    part_category = np.full(count, -1, np.int64)
    part_category[run_part] = category.ravel()[run_start]
    kept = np.flatnonzero((area >= min_pixels) & (part_category >= 0))
    kept = kept[np.lexsort((kept, -area[kept]))]
    renumber = np.full(count, -1, np.int32)
    renumber[kept] = np.arange(len(kept), dtype=np.int32)
    run_part = renumber[run_part]

    of_part = np.argsort(run_part, kind="stable")
    of_part = of_part[run_part[of_part] >= 0]
    bounds = _bounds(run_start[of_part], length[of_part], run_part[of_part], len(kept), width)
    pixel, part = _samples(run_start[of_part], length[of_part], area[kept])
    return Parts(run_part[run], part_category[kept], area[kept], bounds, pixel, part)


def _continues(depth: Float[np.ndarray, "A B"]) -> Bool[np.ndarray, "A1 B"]:
    """Return whether each pixel and the next along the first axis lie on one surface.

    They do when their depths are close, or when they are part of four pixels in a row on one plane. Four, since two
    surfaces blend over a pixel or two at an edge, and three such pixels may look straight.
    """
    close = np.abs(depth[1:] - depth[:-1]) <= jump_limit(depth[1:])
    count = len(depth)
    if count < 4 or close.all():
        return close
    inverse = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    straight = np.abs(inverse[:-2] - 2 * inverse[1:-1] + inverse[2:]) <= BEND * inverse[1:-1]
    plane = straight[:-1] & straight[1:]
    for offset in range(3):
        close[offset : offset + count - 3] |= plane
    return close


def _touching_runs(
    run: Int[np.ndarray, "H W"], joined: Bool[np.ndarray, "H1 W"], starts: Bool[np.ndarray, "H W"]
) -> tuple[Int[np.ndarray, "E"], Int[np.ndarray, "E"]]:
    """Return each pair of vertically joined runs about once: a pair repeats along its whole common edge."""
    first = joined.copy()
    first[:, 1:] &= ~joined[:, :-1] | starts[1:, 1:] | starts[:-1, 1:]
    where = np.flatnonzero(first)
    flat = run.ravel()
    return flat[where], flat[where + run.shape[1]]


def _bounds(
    start: Int[np.ndarray, "R"], length: Int[np.ndarray, "R"], part: Int[np.ndarray, "R"], count: int, width: int
) -> Int64[np.ndarray, "P 4"]:
    if not count:
        return np.zeros((0, 4), np.int64)
    first = np.searchsorted(part, np.arange(count))
    row, left = np.divmod(start, width)
    reduced = (
        np.minimum.reduceat(left, first),
        np.minimum.reduceat(row, first),
        np.maximum.reduceat(left + length - 1, first),
        np.maximum.reduceat(row, first),
    )
    return np.stack(reduced, axis=1).astype(np.int64)


def _samples(
    start: Int[np.ndarray, "R"], length: Int[np.ndarray, "R"], area: Int[np.ndarray, "P"]
) -> tuple[Int64[np.ndarray, "S"], Int64[np.ndarray, "S"]]:
    wanted = np.minimum(area, SAMPLES)
    part = np.repeat(np.arange(len(area)), wanted)
    nth = np.arange(len(part)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
    offset = (np.cumsum(area) - area)[part]
    position = offset + ((nth + 0.5) * area[part] / wanted[part]).astype(np.int64)
    end = np.cumsum(length)
    run = np.searchsorted(end, position, side="right")
    pixel = start[run] + position - (end[run] - length[run])
    return pixel.astype(np.int64), part.astype(np.int64)
