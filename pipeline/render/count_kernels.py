# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""How much a frame blends: the loops of `composite` and `dominate` once more, with counters in the place of images.

Kept apart so that a frame pays nothing for being counted. Serial.
"""

from __future__ import annotations

import numpy as np

from pipeline.render.cached_kernels import kernel
from pipeline.render.project_kernels import RECORD
from pipeline.render.simd_kernels import (
    at,
    bits,
    block_columns,
    block_rows,
    fma,
    larger,
    load,
    minus_magnitude,
    select,
    splat,
    store,
)
from pipeline.render.tile_kernels import ALPHA_CAP, BATCH, BLOCKS, T_MIN, alpha_of, fill_batch

# Floats per block in the state buffer: T, weight.
STATE = 16


@kernel
def count_blends(
    first_tile, last_tile, columns, first_row, width, height, offsets, entries, records, ids, opening, closing,
    live, limits, states, t_stop, dominance, totals,
):  # fmt: skip
    """Add one slab of tiles first_tile to last_tile to `totals`; the first arguments as in `composite`.

    totals (3,) int64: vectors of eight pixels evaluated, those in which some pixel took the Gaussian, pixels that did.
    t_stop (float32) is 0 where nothing is given up. With `dominance`, blocks stop as `dominate` stops them. Keeps
    states (tiles * 512,) float32 between slabs.
    """
    batch = np.empty(BATCH * RECORD, np.float32)
    rows, words = np.empty(BATCH, np.int32), np.empty(BATCH, np.uint32)
    lists = np.empty(BLOCKS * BATCH, np.uint8)
    lengths = np.empty(BLOCKS, np.uint32)
    zero, cap = splat(np.float32(0.0)), splat(ALPHA_CAP)
    log2_alpha_min, t_min = splat(limits[0]), splat(T_MIN)
    for tile in range(first_tile, last_tile):
        alive = live[tile]
        left, top = (tile % columns) * 16, (tile // columns + first_row) * 16
        corner_x, corner_y = np.float32(left) + np.float32(0.5), np.float32(top) + np.float32(0.5)
        tile_state = tile * BLOCKS * STATE
        if opening:
            for block in range(BLOCKS):
                store(states, tile_state + block * STATE, splat(np.float32(1.0)))
                store(states, tile_state + block * STATE + 8, zero)
        begin, end = offsets[tile], offsets[tile + 1]
        while begin < end and alive != 0:
            stop = min(begin + BATCH, end)
            fill_batch(records, entries, begin, stop, corner_x, corner_y, alive, batch, rows, words, lists, lengths)
            begin = stop
            for block in range(BLOCKS):
                length = np.int64(lengths[block])
                if length == 0:
                    continue
                pixel_x = block_columns() + splat(np.float32((block & 3) * 4))
                pixel_y = block_rows() + splat(np.float32((block >> 2) * 2))
                s = tile_state + block * STATE
                t, best = load(states, s), load(states, s + 8)
                for number in range(block * BATCH, block * BATCH + length):
                    a = alpha_of(batch, np.int64(at(lists, number)) * RECORD, pixel_x, pixel_y, log2_alpha_min)
                    w = a * t
                    after = fma(-a, t, t)
                    stops = after < t_min
                    w = select(stops, zero, w)
                    t = select(stops, minus_magnitude(t), after)
                    t = select(t < splat(t_stop), minus_magnitude(t), t)
                    best = larger(w, best)
                    took = bits(w > zero)
                    totals[0] += 1
                    totals[1] += np.int64(took != 0)
                    while took != 0:
                        took &= took - np.uint32(1)
                        totals[2] += 1
                    if dominance:
                        done = bits(t * cap > best) == 0
                    else:
                        done = bits(t > zero) == 0
                    if done:
                        alive &= ~(np.uint32(1) << np.uint32(block))
                        break
                store(states, s, t)
                store(states, s + 8, best)
        live[tile] = np.uint32(0) if closing else alive
