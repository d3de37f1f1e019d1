"""What the loops of the symbolic observer are held to: the parts of a view and what they make up, in plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from pipeline.models.symbolic.components import BEND, SAMPLES, jump_limit
from pipeline.models.symbolic.merge import (
    HIDDEN_GAP_M,
    NEAREST,
    OCCLUDED_SHARE,
    PROBES,
    STANDS_OUT_M,
    UPRIGHT_GAP_M,
    UPRIGHT_OVERLAP,
    WITHIN_M,
)
from pipeline.models.symbolic.shapes import DENT_M, DENT_PER_M, EDGE_SHARE, RIM


@dataclass(frozen=True, slots=True)
class Parts:
    """P parts, largest first; as in `components`."""

    labels: np.ndarray
    category: np.ndarray
    pixels: np.ndarray
    bounds: np.ndarray
    sample_pixel: np.ndarray
    sample_part: np.ndarray


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


def merge_parts(
    parts: Parts,
    depth_m: Float[np.ndarray, "H W"],
    low: Float[np.ndarray, "P 3"],
    high: Float[np.ndarray, "P 3"],
    mergeable: Bool[np.ndarray, "P"],
) -> Int64[np.ndarray, "P"]:
    """Return the object of each part: the index of its largest part.

    Args:
        parts: Parts of a view, largest first.
        depth_m: z-depth of the view, metres.
        low: Lower corner of each part's box in gravity-aligned axes (right, up, forward), metres.
        high: Upper corner.
        mergeable: Parts that may be an object with others; false for walls and the like, which are everywhere.
    """
    owner = np.arange(len(parts.category))
    for first in np.flatnonzero(mergeable).tolist():
        same = np.flatnonzero(parts.category[first + 1 :] == parts.category[first]) + first + 1
        for second in same.tolist():
            if owner[second] == owner[first]:
                continue
            gap = np.maximum(0.0, np.maximum(low[first] - high[second], low[second] - high[first]))
            pair = np.array([first, second])
            if (
                _one_upright_thing(low[pair], high[pair], gap)
                or _one_within_the_other(low[pair], high[pair])
                or (np.linalg.norm(gap) <= HIDDEN_GAP_M and _cut_by_something(parts, depth_m, mergeable, first, second))
            ):
                old, new = max(owner[first], owner[second]), min(owner[first], owner[second])
                owner[owner == old] = new
    return owner.astype(np.int64)


def _one_upright_thing(
    low: Float[np.ndarray, "2 3"], high: Float[np.ndarray, "2 3"], gap: Float[np.ndarray, "3"]
) -> bool:
    if gap[1] > UPRIGHT_GAP_M or gap[0] > 0 or gap[2] > STANDS_OUT_M:
        return False
    stacked = max(low[0, 1], low[1, 1]) > min(high[0, 1], high[1, 1]) - 0.25 * min(high[:, 1] - low[:, 1])
    overlap = np.minimum(high[0], high[1]) - np.maximum(low[0], low[1])
    narrow = np.minimum(high[0] - low[0], high[1] - low[1])
    return bool(stacked and overlap[0] >= UPRIGHT_OVERLAP * narrow[0])


def _one_within_the_other(low: Float[np.ndarray, "2 3"], high: Float[np.ndarray, "2 3"]) -> bool:
    """Specks of a thing that another is drawn over, and the folds of a curtain, lie inside the box of the rest."""
    middle = 0.5 * (low + high)
    inside = (middle >= low[::-1] - WITHIN_M) & (middle <= high[::-1] + WITHIN_M)
    return bool(inside.all(axis=1).any())


def _cut_by_something(
    parts: Parts, depth_m: Float[np.ndarray, "H W"], mergeable: Bool[np.ndarray, "P"], first: int, second: int
) -> bool:
    """Walk from one part to the other where they are closest and ask what lies between.

    A thing before them or on them cuts them apart; the wall or floor beyond is seen between two things.
    """
    width = depth_m.shape[1]
    ends = []
    for part in (first, second):
        begin, end = np.searchsorted(parts.sample_part, [part, part + 1])
        pixels = parts.sample_pixel[begin : end : max(1, (end - begin) // NEAREST)]
        ends.append(np.stack(np.divmod(pixels, width), axis=1))
    a, b = ends[0][:, None], ends[1][None]
    nearest = np.unravel_index(int(((a - b) ** 2).sum(axis=-1).argmin()), (len(ends[0]), len(ends[1])))
    start, stop = ends[0][nearest[0]], ends[1][nearest[1]]
    fraction = (np.arange(PROBES) + 0.5) / PROBES
    row, column = np.rint(start + fraction[:, None] * (stop - start)).astype(np.int64).T
    met = parts.labels[row, column]
    between = (met != first) & (met != second)
    if not between.any():
        return False
    expected = depth_m[start[0], start[1]] * (1 - fraction) + depth_m[stop[0], stop[1]] * fraction
    found = depth_m[row, column]
    building = (met < 0) | ~mergeable[met]
    margin = np.where(building, -0.5, 0.5) * jump_limit(expected)
    return bool(((found > 0) & (found < expected + margin))[between].mean() > OCCLUDED_SHARE)


def free_edges(mask: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"]) -> tuple[float, ...]:
    """Return the share of each upright edge behind which there is nothing near; edges that are not seen are left out.

    A leaf in its frame has the frame or the wall next to both edges; a leaf that stands open has air beside one.

    Args:
        mask: Pixels of the leaf, with at least one pixel of margin where the image goes on.
        depth_m: z-depth of the same pixels, metres.
    """
    limit = jump_limit(depth_m)
    shares = []
    for inner, outer in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        edge = mask[:, inner] & ~mask[:, outer] & (depth_m[:, outer] > 0)
        step = depth_m[:, outer] - depth_m[:, inner]
        seen = edge & (step > -limit[:, inner])
        rows = np.count_nonzero(mask.any(axis=1))
        if np.count_nonzero(seen) >= EDGE_SHARE * rows:
            shares.append(float((step[seen] > 2.0 * limit[:, inner][seen]).mean()))
    return tuple(shares)


def hollow(mask: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"]) -> float:
    """Return the share of a thing's pixels that lie behind the straight line across it, along its row or its column.

    Seen from outside, a closed case is about convex: along any line of the image its inverse depth never falls below
    the line between its ends. Where it does, one looks into it.

    Args:
        mask: Pixels of the thing.
        depth_m: z-depth, metres.
    """
    return max(_hollow_rows(mask, depth_m), _hollow_rows(mask.T, depth_m.T))


def _hollow_rows(mask: Bool[np.ndarray, "a b"], depth: Float[np.ndarray, "a b"]) -> float:
    rows = np.flatnonzero(np.count_nonzero(mask, axis=1) >= 4 * RIM)
    if not len(rows):
        return 0.0
    mask, depth = mask[rows], depth[rows]
    columns = np.arange(mask.shape[1])
    first, last = mask.argmax(axis=1), mask.shape[1] - 1 - mask[:, ::-1].argmax(axis=1)
    # The farthest depth of the rim is taken: one that blends with something nearer would move the line forward.
    line = np.arange(len(rows))[:, None]
    reach = np.arange(1, RIM)
    start, stop = (
        1.0 / np.where(mask[line, at], depth[line, at], 0.0).max(axis=1).clip(min=1e-6)
        for at in (first[:, None] + reach, last[:, None] - reach)
    )
    along = (columns - first[:, None]) / np.maximum(1, last - first)[:, None]
    chord = 1.0 / np.maximum(1e-6, start[:, None] * (1 - along) + stop[:, None] * along)
    return float((mask & (depth > chord + DENT_M + DENT_PER_M * depth)).sum() / mask.sum())
