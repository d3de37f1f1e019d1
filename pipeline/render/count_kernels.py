# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""How much a frame blends: the loops of `composite` and `dominate` once more, with counters in the place of images.

Kept apart so that a frame pays nothing for being counted. Serial.
"""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel
from pipeline.render.project_kernels import RECORD
from pipeline.render.simd_kernels import (
    at,
    bits,
    larger,
    load,
    lowest_bit,
    minus_magnitude,
    select,
    splat,
    store,
)
from pipeline.render.tile_kernels import (
    ALPHA_CAP,
    BATCH,
    BLOCKS,
    alpha_of,
    blended,
    fill_batch,
    new_batch,
    pixels_of,
    tile_corner,
)

# Floats per block in the state buffer: T, weight.
STATE = 16


@kernel
def count_blends(
    first_tile, last_tile, edges, offsets, entries, records, ids, opening, closing,
    live, limits, states, t_stop, dominance, totals,
):  # fmt: skip
    """Add one slab of tiles first_tile to last_tile to `totals`; the first arguments as in `composite`.

    totals (3,) int64: vectors of eight pixels evaluated, those in which some pixel took the Gaussian, pixels that did.
    t_stop (float32) is 0 where nothing is given up. With `dominance`, blocks stop as `dominate` stops them. Keeps
    states (tiles * 512,) float32 between slabs.
    """
    batch, rows, words, masks = new_batch()
    zero, cap = splat(np.float32(0.0)), splat(ALPHA_CAP)
    log2_alpha_min = splat(limits[0])
    for tile in range(first_tile, last_tile):
        alive = live[tile]
        _, _, corner_x, corner_y = tile_corner(tile, edges)
        tile_state = tile * BLOCKS * STATE
        if opening:
            for block in range(BLOCKS):
                store(states, tile_state + block * STATE, splat(np.float32(1.0)))
                store(states, tile_state + block * STATE + 8, zero)
        begin, end = offsets[tile], offsets[tile + 1]
        while begin < end and alive != 0:
            stop = min(begin + BATCH, end)
            fill_batch(records, entries, begin, stop, corner_x, corner_y, alive, batch, rows, words, masks)
            begin = stop
            for block in range(BLOCKS):
                mask = at(masks, block)
                if mask == 0:
                    continue
                pixel_x, pixel_y = pixels_of(block)
                s = tile_state + block * STATE
                t, best = load(states, s), load(states, s + 8)
                while mask != 0:
                    entry = lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    a = alpha_of(batch, entry * RECORD, pixel_x, pixel_y, log2_alpha_min)
                    w, t, _ = blended(a, t)
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
