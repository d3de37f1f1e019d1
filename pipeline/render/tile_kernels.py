# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""What compositing and dominance share: a tile's batches, the blocks each record covers, and alpha.

A tile of 16 x 16 pixels is 32 blocks of 4 x 2 pixels, one vector each, numbered row by row; a set of blocks is a
32-bit word. Records come in batches: for each one the row spans of its ellipse give its blocks, its parameters are
moved to the tile's corner and copied side by side, and its place is appended to the list of every block it covers.
The caller then takes the blocks one by one, with a block's whole state in registers.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.project_kernels import (
    BLUE,
    BOUND,
    DEPTH,
    GREEN,
    INVERSE_MU,
    LOG2_OPACITY,
    MU,
    MV,
    NV,
    RECORD,
    RED,
    SLACK,
    SLOPE,
    U,
    V,
)
from pipeline.render.simd_kernels import (
    fma,
    lane_numbers,
    larger,
    lowest_bit,
    nibble_shifts,
    prefetch,
    select,
    smaller,
    splat,
    splat_at,
    square_root,
    truncate,
    union,
)

BATCH = 128
"""Records per batch: parameters (8 KB) and lists (16 KB) stay in a 32 KB first-level cache."""
BLOCKS = 32
# Offsets in a batch entry.
M_X, M_Y, M_0, N_Y, N_0, LOG2, Z, R, G, B = range(10)
ENTRY = 16

ALPHA_CAP = np.float32(0.99)
ALPHA_MIN = np.float32(1.0 / 255.0)
T_MIN = np.float32(1e-4)
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
def covered_blocks(records, r, corner_x, corner_y):
    """Return the blocks of a tile that a record's 1/255 ellipse may touch.

    Lane i holds pixel rows 2 i and 2 i + 1 of the tile; corner_x, corner_y is the tile's first pixel centre.
    """
    zero, limit = splat(np.float32(0.0)), splat(np.float32(16.0))
    center = splat(records[r + U] - corner_x)
    slope, inverse_mu = splat(records[r + SLOPE]), splat(records[r + INVERSE_MU])
    nv, bound = splat(records[r + NV]), splat(records[r + BOUND])
    slack, round_up = splat(SLACK), splat(np.float32(1.0) - SLACK)
    even = fma(lane_numbers(), splat(np.float32(2.0)), splat(corner_y - records[r + V]))
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
def fill_batch(records, entries, begin, end, corner_x, corner_y, live, batch, rows, lists, lengths):
    """Copy the records `entries[begin:end]` that touch a live block into `batch` and list them by block."""
    for block in range(BLOCKS):
        lengths[block] = 0
    count = 0
    for k in range(begin, end):
        prefetch(records, np.int64(entries[min(k + AHEAD, end - 1)]) * RECORD)
        row = np.int64(entries[k])
        r = row * RECORD
        word = covered_blocks(records, r, corner_x, corner_y) & live
        if word == 0:
            continue
        e = count * ENTRY
        dx, dy = corner_x - records[r + U], corner_y - records[r + V]
        mu, mv, nv = records[r + MU], records[r + MV], records[r + NV]
        batch[e + M_X] = mu
        batch[e + M_Y] = mv
        batch[e + M_0] = mu * dx + mv * dy
        batch[e + N_Y] = nv
        batch[e + N_0] = nv * dy
        batch[e + LOG2] = records[r + LOG2_OPACITY]
        batch[e + Z] = records[r + DEPTH]
        batch[e + R] = records[r + RED]
        batch[e + G] = records[r + GREEN]
        batch[e + B] = records[r + BLUE]
        rows[count] = row
        while word != 0:
            block = lowest_bit(word)
            word &= word - np.uint32(1)
            lists[block * BATCH + lengths[block]] = count
            lengths[block] += 1
        count += 1


@njit(error_model="numpy")
def alpha_of(batch, e, pixel_x, pixel_y):
    """Return the alpha of a batch entry at eight pixels (offsets from the tile's corner); 0 where below 1/255."""
    m = fma(splat_at(batch, e + M_X), pixel_x, fma(splat_at(batch, e + M_Y), pixel_y, splat_at(batch, e + M_0)))
    n = fma(splat_at(batch, e + N_Y), pixel_y, splat_at(batch, e + N_0))
    power = fma(-m, m, fma(-n, n, splat_at(batch, e + LOG2)))
    x = larger(power, splat(np.float32(-9.0)))
    p = fma(x, fma(x, fma(x, fma(x, fma(x, splat(E5), splat(E4)), splat(E3)), splat(E2)), splat(E1)), splat(E0))
    p = p * p
    p = p * p
    p = smaller(p * p, splat(ALPHA_CAP))
    return select(p >= splat(ALPHA_MIN), p, splat(np.float32(0.0)))
