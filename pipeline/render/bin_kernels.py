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
from pipeline.render.simd_kernels import at, prefetch, put

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
    slope, inverse_mu, nv = at(records, r + SLOPE), at(records, r + INVERSE_MU), at(records, r + NV)
    bound, extreme = at(records, r + BOUND), at(records, r + EXTREME)
    u, v = at(records, r + U) - np.float32(0.5), at(records, r + V) - np.float32(0.5)
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
def row_of(key):
    """Return the row in the lower half of a key."""
    return np.int64(key & np.uint64(0xFFFFFFFF))


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
    used, kept = np.int64(0), np.int64(0)
    room = pairs.size - (last_row - first_row) * columns
    for k in range(first, last):
        ahead = row_of(at(keys, min(k + AHEAD, last - 1)))
        prefetch(rectangles, ahead * 2)
        ahead = row_of(at(keys, min(k + AHEAD // 2, last - 1)))
        if several(at(rectangles, 2 * ahead)) and several(at(rectangles, 2 * ahead + 1)):
            prefetch(records, ahead * RECORD)
        if used > room:
            ends[0], ends[1], ends[2] = k, used, kept
            return
        record = row_of(at(keys, k))
        across, down = at(rectangles, 2 * record), at(rectangles, 2 * record + 1)
        left, right = np.int64(across & 0xFFFF), np.int64(across >> 16)
        upper, lower = (
            max(np.int64(down & 0xFFFF), first_row) - first_row,
            min(np.int64(down >> 16), last_row - 1) - first_row,
        )
        # Most records behind a finished wall go here: four loads, no loop.
        above, below = upper * (columns + 1), (lower + 1) * (columns + 1)
        if upper > lower or (
            at(live_sums, below + right + 1)
            - at(live_sums, below + left)
            - at(live_sums, above + right + 1)
            + at(live_sums, above + left)
            == 0
        ):
            continue
        put(touched, kept, np.int32(record))
        before = used
        exact = upper < lower and left < right
        begin, end = left, right
        for tile_row in range(upper, lower + 1):
            if exact:
                begin, end = row_ends(records, record * RECORD, tile_row + first_row, left, right)
            for tile in range(tile_row * columns + begin, tile_row * columns + end + 1):
                # Written in any case, kept where the tile still wants it: no branch to mispredict.
                put(pairs, used, (np.uint64(tile) << np.uint64(32)) | np.uint64(record))
                wanted = np.int64(at(live, tile) != 0)
                put(counts, tile, at(counts, tile) + wanted)
                used += wanted
        kept += np.int64(used > before)
    ends[0], ends[1], ends[2] = last, used, kept


@kernel
def scatter(pairs, count, cursors, entries):
    """Write the records of `pairs[:count]` to their tiles' stretches of `entries`, in order; `cursors` move along."""
    for k in range(count):
        pair = at(pairs, k)
        tile = np.int64(pair >> np.uint64(32))
        place = at(cursors, tile)
        put(entries, place, np.int32(pair & np.uint64(0xFFFFFFFF)))
        put(cursors, tile, place + 1)
