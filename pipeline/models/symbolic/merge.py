"""Which parts of a view are one object: those that something nearer cuts apart, and those that stand on one spot."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int64

from pipeline.models.symbolic.components import Parts, jump_limit

HIDDEN_GAP_M = 0.4
"""Widest gap bridged behind an occluder: a chair before a bed hides about this much of it."""
UPRIGHT_GAP_M = 0.45
"""Tallest gap bridged within one upright thing, such as the pole between a lamp's shade and foot."""
UPRIGHT_OVERLAP = 0.5
"""Share of the narrower part's width that must lie over the other for them to be one upright thing."""
STANDS_OUT_M = 0.15
"""How far one part of an upright thing may stand out before the other, as a lamp's shade does."""
WITHIN_M = 0.08
"""A part whose middle lies this close to the box of another of the same name belongs to it."""
OCCLUDED_SHARE = 0.5
"""Share of the pixels between two parts that must lie before them or on them."""
NEAREST = 48
"""Pixels of each part tried for where two parts are closest."""
PROBES = 16
"""Pixels looked at between two parts."""


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
