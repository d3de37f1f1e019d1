# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Binning: which 16 x 16 tiles each record touches, then the records of each tile in depth order.

`list_tiles` walks records in memory order and writes each record's tiles once, counting per tile; `scatter` walks
them in depth order and drops each into its tiles: a stable counting sort, so no tile is ever sorted. A tile is
touched exactly when the 1/255 ellipse crosses the band of its pixel centres: in each row of tiles the ellipse is a
convex slice, whose ends are found with one square root each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.project_kernels import BOUND as BOUND_FIELD
from pipeline.render.project_kernels import HALF_HEIGHT, HALF_WIDTH, INVERSE_MU, NV, RECORD, SLOPE, U, V

TILE = 16
TILE_SHIFT = 4
SLACK = np.float32(1e-3)
"""Pixels added to every span for rounding; too large costs time only, alpha is tested again per pixel."""


@njit(error_model="numpy")
def clamped_floor(x, low, high):
    """Return floor(x) within [low, high]; x may be infinite."""
    return np.int64(np.floor(min(max(x, np.float32(low)), np.float32(high))))


@njit(nogil=True, cache=True, error_model="numpy")
def list_tiles(records, first, last, width, height, first_row, last_row, columns, starts, tiles, used, counts):
    """List the tiles of records from `first` on, in tile rows first_row to last_row.

    Args:
        starts: (rows + 1,) int64; starts[r]:starts[r + 1] are record r's entries in `tiles`, written.
        tiles: (capacity,) int32, written from `used` on.
        counts: (tiles of the band,) int64, increased.

    Returns:
        The record at which `tiles` was full, or `last`.
    """
    top, bottom = first_row * TILE, min(height, last_row * TILE) - 1
    starts[first] = used
    for record in range(first, last):
        r = record * RECORD
        u, v = records[r + U] - np.float32(0.5), records[r + V] - np.float32(0.5)
        half_width, half_height = records[r + HALF_WIDTH], records[r + HALF_HEIGHT]
        x0 = -clamped_floor(half_width - u + SLACK, -width, 0)
        x1 = clamped_floor(u + half_width + SLACK, -1, width - 1)
        y0 = max(-clamped_floor(half_height - v + SLACK, -height, 0), top)
        y1 = min(clamped_floor(v + half_height + SLACK, -1, height - 1), bottom)
        if x0 <= x1 and y0 <= y1:
            left, right = x0 >> TILE_SHIFT, x1 >> TILE_SHIFT
            upper, lower = y0 >> TILE_SHIFT, y1 >> TILE_SHIFT
            if used + (right - left + 1) * (lower - upper + 1) > tiles.size:
                return record
            if upper == lower or left == right:
                for tile_row in range(upper, lower + 1):
                    for column in range(left, right + 1):
                        tile = (tile_row - first_row) * columns + column
                        tiles[used] = tile
                        counts[tile] += 1
                        used += 1
            else:
                slope, inverse_mu, nv = records[r + SLOPE], records[r + INVERSE_MU], records[r + NV]
                bound = records[r + BOUND_FIELD]
                # The ellipse's rightmost point lies at this height over the centre, its leftmost at minus that.
                extreme = -slope * half_height * half_height / half_width
                for tile_row in range(upper, lower + 1):
                    band0 = np.float32(max(y0, tile_row * TILE)) - v
                    band1 = np.float32(min(y1, tile_row * TILE + TILE - 1)) - v
                    dy = min(max(extreme, band0), band1)
                    n = nv * dy
                    x_right = u - slope * dy + np.sqrt(max(bound - n * n, np.float32(0.0))) * inverse_mu + SLACK
                    dy = min(max(-extreme, band0), band1)
                    n = nv * dy
                    x_left = u - slope * dy - np.sqrt(max(bound - n * n, np.float32(0.0))) * inverse_mu - SLACK
                    begin = max(-clamped_floor(-x_left, -width, 0), x0) >> TILE_SHIFT
                    end = min(clamped_floor(x_right, -TILE, width - 1), x1) >> TILE_SHIFT
                    for column in range(begin, end + 1):
                        tile = (tile_row - first_row) * columns + column
                        tiles[used] = tile
                        counts[tile] += 1
                        used += 1
        starts[record + 1] = used
    return last


@njit(nogil=True, cache=True, error_model="numpy")
def scatter(keys, starts, tiles, cursors, entries):
    """Write each record into its tiles' stretches of `entries`, in key order; `cursors` (int64) move along."""
    for k in range(keys.size):
        row = np.int64(keys[k] & np.uint64(0xFFFFFFFF))
        for j in range(starts[row], starts[row + 1]):
            tile = tiles[j]
            entries[cursors[tile]] = row
            cursors[tile] += 1
