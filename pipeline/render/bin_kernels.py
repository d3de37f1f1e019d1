# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Binning: the unfinished tiles each record touches, then the records of each tile in depth order.

Work is split over ranges of the depth order. `list_tiles` writes a range's (tile, record) pairs in depth order and
counts them per tile; `scatter` drops each pair into its tile's stretch: a stable counting sort, so no tile is ever
sorted. Records within 2 x 2 tiles take all of them; a larger one touches a tile when its 1/255 ellipse crosses the band
of the tile's pixel centres: in each row of tiles the ellipse is a convex slice, whose ends are found with one square
root each, eight rows at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel
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
    tiles_in,
)
from pipeline.render.simd_kernels import (
    at,
    fma,
    lane_numbers,
    larger,
    prefetch,
    put,
    smaller,
    splat,
    splat_at,
    square_root,
    store,
    truncate,
)

AHEAD = 24
"""Keys between asking for a rectangle and reading it; half as many for a record."""
ROUND_UP = np.float32(0.9)
"""Makes nearly a ceiling of a truncation, also where pixels are counted in hundreds of thousands."""


@njit(error_model="numpy")
def row_ends(records, r, tile_row, left, right, begins, ends):
    """Write the first and last tile between `left` and `right` that a record's ellipse crosses in eight rows of tiles.

    The ellipse's rightmost point lies EXTREME pixels below the centre, its leftmost as far above. Rounding, and a
    place that is no number, can only add a tile.
    """
    slope, inverse_mu, nv = splat_at(records, r + SLOPE), splat_at(records, r + INVERSE_MU), splat_at(records, r + NV)
    bound, extreme = splat_at(records, r + BOUND), splat_at(records, r + EXTREME)
    u = splat(at(records, r + U) - np.float32(0.5))
    zero, slack, shift = splat(np.float32(0.0)), splat(SLACK), splat(np.int32(TILE_SHIFT))
    first_y = np.float32(tile_row << TILE_SHIFT) - (at(records, r + V) - np.float32(0.5))
    band0 = fma(lane_numbers(), splat(np.float32(1 << TILE_SHIFT)), splat(first_y))
    band1 = band0 + splat(np.float32((1 << TILE_SHIFT) - 1))
    low, high = splat(np.float32(left << TILE_SHIFT)), splat(np.float32((right + 1) << TILE_SHIFT))
    dy = smaller(larger(-extreme, band0), band1)
    n = nv * dy
    x = fma(-slope, dy, u) - square_root(larger(fma(-n, n, bound), zero)) * inverse_mu
    store(begins, 0, truncate(smaller(larger(x + splat(ROUND_UP), low), high)) >> shift)
    dy = smaller(larger(extreme, band0), band1)
    n = nv * dy
    x = fma(-slope, dy, u) + square_root(larger(fma(-n, n, bound), zero)) * inverse_mu + slack
    one = splat(np.float32(1.0))
    store(ends, 0, truncate(larger(smaller(x, high - one), low - one)) >> shift)


@njit(error_model="numpy")
def row_of(key):
    """Return the row in the lower half of a key."""
    return np.int64(key & np.uint64(0xFFFFFFFF))


@njit(error_model="numpy")
def tiles_between(word):
    """Return how far apart the two numbers are that a word holds in 16 bits each."""
    return (word >> 16) - (word & 0xFFFF)


@njit(error_model="numpy")
def list_tile(tile, wanted, record, live, pairs, counts, used):
    """Append a pair if `wanted` (0 or 1) and if the tile still wants records; return the number of pairs.

    It is written in any case and kept by counting on: no branch to mispredict.
    """
    put(pairs, used, (np.uint64(tile) << np.uint64(32)) | np.uint64(record))
    wanted &= np.int64(at(live, tile) != 0)
    put(counts, tile, at(counts, tile) + wanted)
    return used + wanted


@kernel
def list_tiles(keys, first, last, records, rectangles, edges, live, live_sums, pairs, counts, touched, ends):
    """List the live tiles of the records of `keys[first:last]`, in the band of these edges (see `Window`).

    Writes pairs (uint64: tile << 32 | record), counts (int64 per tile of the band, increased) and touched (int32:
    records with a pair). `live` is non-zero for tiles that still want records, live_sums
    (rows + 1, columns + 1) counts those above and to the left. `ends` gets the key at which `pairs` was
    too full for one more record (or `last`), the number of pairs and the number of records touched.
    """
    used, kept = np.int64(0), np.int64(0)
    first_column, first_row = edges[0] >> TILE_SHIFT, edges[1] >> TILE_SHIFT
    columns, rows = tiles_in(edges)
    begins, ends_of_rows = np.empty(8, np.int32), np.empty(8, np.int32)
    room = pairs.size - max(rows * columns, 4)
    for k in range(first, last):
        ahead = row_of(at(keys, min(k + AHEAD, last - 1)))
        prefetch(rectangles, ahead * 2)
        ahead = row_of(at(keys, min(k + AHEAD // 2, last - 1)))
        if tiles_between(at(rectangles, 2 * ahead)) > 1 or tiles_between(at(rectangles, 2 * ahead + 1)) > 1:
            prefetch(records, ahead * RECORD)
        if used > room:
            ends[0], ends[1], ends[2] = k, used, kept
            return
        record = row_of(at(keys, k))
        across, down = at(rectangles, 2 * record), at(rectangles, 2 * record + 1)
        left, right = np.int64(across & 0xFFFF) - first_column, np.int64(across >> 16) - first_column
        upper = max(np.int64(down & 0xFFFF) - first_row, 0)
        lower = min(np.int64(down >> 16) - first_row, rows - 1)
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
        wide, tall = right - left, lower - upper
        if wide < 2 and tall < 2:
            # Up to four tiles with no loop whose end could be mispredicted; nearly all of them are really crossed.
            used = list_tile(upper * columns + left, 1, record, live, pairs, counts, used)
            used = list_tile(upper * columns + right, wide, record, live, pairs, counts, used)
            used = list_tile(lower * columns + left, tall, record, live, pairs, counts, used)
            used = list_tile(lower * columns + right, wide & tall, record, live, pairs, counts, used)
        else:
            begin, end = left, right
            for tile_row in range(upper, lower + 1):
                if wide > 0 and tall > 0:
                    lane = (tile_row - upper) & 7
                    if lane == 0:
                        row_ends(
                            records, record * RECORD, tile_row + first_row, left + first_column, right + first_column,
                            begins, ends_of_rows,
                        )  # fmt: skip
                    begin, end = at(begins, lane) - first_column, at(ends_of_rows, lane) - first_column
                for tile in range(tile_row * columns + begin, tile_row * columns + end + 1):
                    used = list_tile(tile, 1, record, live, pairs, counts, used)
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
