# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""What compositing and dominance share: a tile's batches, the blocks each record covers, and alpha.

A tile of 16 x 16 pixels is 32 blocks of 4 x 2 pixels, one vector each, numbered row by row; a set of blocks is a
32-bit word. Records come in batches: for each one the row spans of its ellipse give its blocks, its parameters are
moved to the tile's corner and copied side by side, and its bit is set in the mask of every block it covers.
The caller then takes the blocks one by one, with a block's whole state in registers.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.project_kernels import (
    BOUND,
    INVERSE_MU,
    LOG2_OPACITY,
    MU,
    MV,
    NV,
    RECORD,
    SLACK,
    SLOPE,
    U,
    V,
    tiles_in,
)
from pipeline.render.simd_kernels import (
    at,
    block_columns,
    block_rows,
    fma,
    lane_numbers,
    larger,
    load,
    minus_magnitude,
    nibble_shifts,
    prefetch,
    put,
    select,
    smaller,
    splat,
    splat_at,
    square_root,
    store,
    truncate,
    union,
)
from pipeline.render.transpose_kernels import transpose_bits

BATCH = 64
"""Records per batch, the bits of a mask: their parameters (4 KB) stay in the first-level cache."""
BLOCKS = 32
# A batch entry is a record, but that m and n at the tile's first pixel centre stand in the place of u and v.
M_0, N_0 = U, V
PLACE = 15
"""Where a batch entry says how many entries after `begin` it came."""

ALPHA_CAP = np.float32(0.99)
T_MIN = np.float32(1e-4)
"""A contribution that would leave less transmittance than this is not added, and the pixel stops."""
AHEAD = 8
"""Entries between asking for a record and reading it."""

# 2^x = p(x)^8 for x in [-8, 0]: p is the best degree-5 fit of 2^(x/8) in relative error, which leaves 6e-7.
E0, E1, E2, E3, E4, E5 = (
    np.float32(c)
    for c in (
        9.999999250634355e-01,
        8.664278157367111e-02,
        3.752690456092930e-03,
        1.079682080174233e-04,
        2.243313391512e-06,
        2.864954e-08,
    )
)


@njit(error_model="numpy")
def tile_corner(tile, edges):
    """Return the first pixel column and row of a tile, counted from its band's corner, and its first pixel centre.

    The centre is a place in the image, float32. Tiles of a band (see `Window` for its edges) are numbered row by row.
    """
    columns, _ = tiles_in(edges)
    left, top = (tile % columns) * 16, (tile // columns) * 16
    return left, top, np.float32(edges[0] + left) + np.float32(0.5), np.float32(edges[1] + top) + np.float32(0.5)


@njit(error_model="numpy")
def new_batch():
    """Return what `fill_batch` fills: parameters and rows of records, words of their blocks, masks of the blocks."""
    return (
        np.empty(BATCH * RECORD, np.float32),
        np.empty(BATCH, np.int32),
        np.empty(BATCH, np.uint32),
        np.empty(32, np.uint64),  # as many as a word has bits, whatever the number of blocks
    )


@njit(error_model="numpy")
def lane_at(x, y):
    """Return the block and, in it, the lane of the pixel in column x and row y of a tile."""
    return (y >> 1) * 4 + (x >> 2), (y & 1) * 4 + (x & 3)


@njit(error_model="numpy")
def pixels_of(block):
    """Return the columns and the rows of a block's pixels in its tile."""
    x, y = splat(np.float32((block & 3) * 4)), splat(np.float32((block >> 2) * 2))
    return block_columns() + x, block_rows() + y


@njit(error_model="numpy")
def copy_vectors(source, at_source, target, at_target, count):
    """Copy `count` vectors of eight."""
    for k in range(count):
        store(target, at_target + k * 8, load(source, at_source + k * 8))


@njit(error_model="numpy")
def covered_blocks(records, r, corner_x, corner_y):
    """Return the blocks of a tile that a record's 1/255 ellipse may touch.

    Lane i holds pixel rows 2 i and 2 i + 1 of the tile; corner_x, corner_y is the tile's first pixel centre.
    """
    zero, limit = splat(np.float32(0.0)), splat(np.float32(16.0))
    center = splat(at(records, r + U) - corner_x)
    slope, inverse_mu = splat_at(records, r + SLOPE), splat_at(records, r + INVERSE_MU)
    nv, bound = splat_at(records, r + NV), splat_at(records, r + BOUND)
    slack, round_up = splat(SLACK), splat(np.float32(1.0) - SLACK)
    even = fma(lane_numbers(), splat(np.float32(2.0)), splat(corner_y - at(records, r + V)))
    odd = even + splat(np.float32(1.0))
    n = nv * even
    room = fma(-n, n, bound)
    inside = room >= zero
    half = square_root(larger(room, zero)) * inverse_mu
    middle = fma(-slope, even, center)
    first = select(inside, middle - half, limit)
    last = select(inside, middle + half, -limit)
    n = nv * odd
    room = fma(-n, n, bound)
    inside = room >= zero
    half = square_root(larger(room, zero)) * inverse_mu
    middle = fma(-slope, odd, center)
    first = smaller(first, select(inside, middle - half, limit))
    last = larger(last, select(inside, middle + half, -limit)) + slack
    # Ceiling and floor by truncation: both ends are 0 or more where it matters.
    low = truncate(smaller(larger(first + round_up, zero), limit))
    high = truncate(smaller(larger(last, zero), splat(np.float32(15.0))))
    touched = (last >= zero) & (low <= high)
    two, one, no = splat(np.int32(2)), splat(np.int32(1)), splat(np.int32(0))
    nibble = (two << (high >> two)) - (one << (low >> two))
    return union(select(touched, nibble, no) << nibble_shifts())


@njit(error_model="numpy")
def fill_batch(records, entries, begin, end, corner_x, corner_y, live, batch, rows, words, masks):
    """Copy the records `entries[begin:end]` that touch a live block into `batch`; bit k of a block's mask is entry k.

    No branch depends on a record: every mispredicted one would wait for a whole chain of square roots.
    """
    count = np.int64(0)
    for k in range(begin, end):
        prefetch(records, np.int64(at(entries, min(k + AHEAD, end - 1))) * RECORD)
        row = np.int64(at(entries, k))
        r, e = row * RECORD, count * RECORD
        dx, dy = corner_x - at(records, r + U), corner_y - at(records, r + V)
        mu, mv, nv = at(records, r + MU), at(records, r + MV), at(records, r + NV)
        store(batch, e, load(records, r))
        store(batch, e + 8, load(records, r + 8))
        put(batch, e + M_0, mu * dx + mv * dy)
        put(batch, e + N_0, nv * dy)
        put(batch, e + PLACE, np.float32(k - begin))
        put(rows, count, np.int32(row))
        word = covered_blocks(records, r, corner_x, corner_y) & live
        put(words, count, word)
        count += np.int64(word != 0)  # or else the next entry takes its place
    for k in range(count, BATCH):
        put(words, k, np.uint32(0))
    transpose_bits(words, masks)


@njit(error_model="numpy")
def alpha_of(batch, e, pixel_x, pixel_y, log2_alpha_min):
    """Return the alpha of a batch entry at eight pixels (offsets from the tile's corner); 0 where below the cut-off.

    The cut-off (1/255 or more) is tested before the exponential, where float32 is finest.
    """
    m = fma(splat_at(batch, e + MU), pixel_x, fma(splat_at(batch, e + MV), pixel_y, splat_at(batch, e + M_0)))
    n = fma(splat_at(batch, e + NV), pixel_y, splat_at(batch, e + N_0))
    x = fma(-m, m, fma(-n, n, splat_at(batch, e + LOG2_OPACITY)))
    p = fma(x, fma(x, fma(x, fma(x, fma(x, splat(E5), splat(E4)), splat(E3)), splat(E2)), splat(E1)), splat(E0))
    p = p * p
    p = p * p
    p = smaller(p * p, splat(ALPHA_CAP))
    # Lanes under the cut-off may hold anything, infinity too, but not after this.
    return select(x >= log2_alpha_min, p, splat(np.float32(0.0)))


@njit(error_model="numpy")
def blended(a, t):
    """Return the weights of a Gaussian of alpha `a`, the transmittances behind it, and the pixels it stops.

    A pixel that has stopped keeps its transmittance as a negative number; a weight of 0 or less counts for nothing.
    """
    w, after = a * t, fma(-a, t, t)
    stops = after < splat(T_MIN)
    return select(stops, splat(np.float32(0.0)), w), select(stops, minus_magnitude(t), after), stops
