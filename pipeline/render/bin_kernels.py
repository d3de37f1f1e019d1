# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Binning: the unfinished tiles each record touches, then the records of each tile in depth order.

Work is split over ranges of the depth order. `list_tiles` writes a range's (tile, record) pairs in depth order and
counts them per tile; `scatter` drops each pair into its tile's stretch: a stable counting sort, so no tile is ever
sorted. A tile is touched exactly when the 1/255 ellipse crosses the band of its pixel centres: in each row of tiles
the ellipse is a convex slice, whose ends are found with one square root each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.cached_kernels import kernel
from pipeline.render.project_kernels import (
    BOUND,
    EXTREME,
    INVERSE_MU,
    NV,
    RECORD,
    SLACK,
    SLOPE,
    TILE_SHIFT,
    U,
    V,
)
from pipeline.render.simd_kernels import prefetch

AHEAD = 12
"""Keys between asking for a record and reading it."""


@njit(error_model="numpy")
def clamped_floor(x, low, high):
    """Return floor(x) within [low, high]; x may be infinite."""
    return np.int64(np.floor(min(max(x, np.float32(low)), np.float32(high))))


@njit(error_model="numpy")
def row_ends(records, r, tile_row, left, right):
    """Return the first and last tile between `left` and `right` that a record's ellipse crosses in a row of tiles.

    The ellipse's rightmost point lies EXTREME pixels below the centre, its leftmost as far above.
    """
    slope, inverse_mu, nv = records[r + SLOPE], records[r + INVERSE_MU], records[r + NV]
    bound, extreme = records[r + BOUND], records[r + EXTREME]
    u, v = records[r + U] - np.float32(0.5), records[r + V] - np.float32(0.5)
    band0 = np.float32(tile_row << TILE_SHIFT) - v
    band1 = band0 + np.float32((1 << TILE_SHIFT) - 1)
    dy = min(max(extreme, band0), band1)
    n = nv * dy
    x_right = u - slope * dy + np.sqrt(max(bound - n * n, np.float32(0.0))) * inverse_mu + SLACK
    dy = min(max(-extreme, band0), band1)
    n = nv * dy
    x_left = u - slope * dy - np.sqrt(max(bound - n * n, np.float32(0.0))) * inverse_mu - SLACK
    first = -clamped_floor(-x_left, -((right + 1) << TILE_SHIFT), -(left << TILE_SHIFT)) >> TILE_SHIFT
    last = clamped_floor(x_right, (left << TILE_SHIFT) - 1, ((right + 1) << TILE_SHIFT) - 1) >> TILE_SHIFT
    return first, last


@njit(error_model="numpy")
def several(word):
    """Return whether a range of 16-bit halves holds more than one number."""
    return (word & 0xFFFF) != (word >> 16)


@kernel
def list_tiles(
    keys, first, last, records, rectangles, first_row, last_row, columns, live, live_sums, pairs, counts, touched, ends
):
    """List the live tiles of the records of `keys[first:last]`, in tile rows first_row to last_row.

    Writes pairs (uint64: tile << 32 | record), counts (int64 per tile of the band, increased) and touched (int32:
    records with a pair). `live` is non-zero for tiles that still want records, live_sums
    (rows + 1, columns + 1) counts those above and to the left. `ends` gets the key at which `pairs` was
    too full for one more record (or `last`), the number of pairs and the number of records touched.
    """
    used, kept = 0, 0
    room = pairs.size - (last_row - first_row) * columns
    for k in range(first, last):
        ahead = np.int64(keys[min(k + AHEAD, last - 1)] & np.uint64(0xFFFFFFFF))
        prefetch(rectangles, ahead * 2)
        ahead = np.int64(keys[min(k + AHEAD // 2, last - 1)] & np.uint64(0xFFFFFFFF))
        if several(rectangles[2 * ahead]) and several(rectangles[2 * ahead + 1]):
            prefetch(records, ahead * RECORD)
        record = np.int64(keys[k] & np.uint64(0xFFFFFFFF))
        left, right = np.int64(rectangles[2 * record] & 0xFFFF), np.int64(rectangles[2 * record] >> 16)
        upper = max(np.int64(rectangles[2 * record + 1] & 0xFFFF), first_row)
        lower = min(np.int64(rectangles[2 * record + 1] >> 16), last_row - 1)
        if used > room:
            ends[0], ends[1], ends[2] = k, used, kept
            return
        # Most records behind a finished wall go here: four loads, no loop.
        high, low = (upper - first_row) * (columns + 1), (lower + 1 - first_row) * (columns + 1)
        if upper > lower or (
            live_sums[low + right + 1] - live_sums[low + left] - live_sums[high + right + 1] + live_sums[high + left]
            == 0
        ):
            continue
        before = used
        exact = upper < lower and left < right
        for tile_row in range(upper, lower + 1):
            start = (tile_row - first_row) * columns
            begin, end = left, right
            while begin <= end and live[start + begin] == 0:
                begin += 1
            if begin > end:
                continue
            if exact:
                low, high = row_ends(records, record * RECORD, tile_row, left, right)
                begin, end = max(begin, low), high
            for tile in range(start + begin, start + end + 1):
                if live[tile] != 0:
                    pairs[used] = (np.uint64(tile) << np.uint64(32)) | np.uint64(record)
                    used += 1
                    counts[tile] += 1
        if used > before:
            touched[kept] = record
            kept += 1
    ends[0], ends[1], ends[2] = last, used, kept


@kernel
def scatter(pairs, count, cursors, entries):
    """Write the records of `pairs[:count]` to their tiles' stretches of `entries`, in order; `cursors` move along."""
    for k in range(count):
        tile = pairs[k] >> np.uint64(32)
        entries[cursors[tile]] = np.int32(pairs[k] & np.uint64(0xFFFFFFFF))
        cursors[tile] += 1
