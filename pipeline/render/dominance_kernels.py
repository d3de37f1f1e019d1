# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The dominant Gaussian of every pixel and nothing else, for a range of tiles.

Same split and same arithmetic as `composite_kernels`, so the indices are equal to the last one; but no colour and no
depth, and a pixel is done as soon as 0.99 T, the most anything behind can weigh, does not beat its largest weight.
"""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel
from pipeline.render.project_kernels import RECORD
from pipeline.render.simd_kernels import (
    at,
    bits,
    load,
    lowest_bit,
    minus_magnitude,
    select,
    splat,
    splat_at,
    store,
)
from pipeline.render.tile_kernels import (
    ALPHA_CAP,
    BATCH,
    BLOCKS,
    alpha_of,
    blended,
    copy_vectors,
    fill_batch,
    lane_at,
    new_batch,
    pixels_of,
    tile_corner,
)

# Floats per block in the state buffer: T, weight.
STATE = 16


@kernel
def dominate(
    first_tile, last_tile, edges, offsets, entries, records, ids, opening, closing,
    live, limits, states, winner_states, t_stop, dominant, weight,
):  # fmt: skip
    """Write `dominant` (H * W,) int32 and `weight` (H * W,) float32 of a range of tiles; arguments as in `composite`.

    Here states are (tiles * 512,) float32.
    """
    state = np.empty(BLOCKS * STATE, np.float32)
    winners = np.empty(BLOCKS * 8, np.int32)
    batch, rows, words, masks = new_batch()
    zero, cap = splat(np.float32(0.0)), splat(ALPHA_CAP)
    log2_alpha_min = splat(limits[0])
    width, height = edges[2] - edges[0], edges[3] - edges[1]
    for tile in range(first_tile, last_tile):
        alive = live[tile]
        if alive == 0 or (offsets[tile] == offsets[tile + 1] and not (opening or closing)):
            continue
        left, top, corner_x, corner_y = tile_corner(tile, edges)
        if opening:
            for block in range(BLOCKS):
                store(state, block * STATE, splat(np.float32(1.0)))
                store(state, block * STATE + 8, zero)
                store(winners, block * 8, splat(np.int32(-1)))
        else:
            copy_vectors(states, tile * BLOCKS * STATE, state, 0, BLOCKS * STATE // 8)
            copy_vectors(winner_states, tile * BLOCKS * 8, winners, 0, BLOCKS)
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
                t = load(state, block * STATE)
                best = load(state, block * STATE + 8)
                winner = load(winners, block * 8)
                while mask != 0:
                    entry = lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    a = alpha_of(batch, entry * RECORD, pixel_x, pixel_y, log2_alpha_min)
                    w, t, _ = blended(a, t)
                    if t_stop is not None:
                        t = select(t < splat(t_stop), minus_magnitude(t), t)
                    more = w > best
                    best = select(more, w, best)
                    winner = select(more, splat_at(rows, entry), winner)
                    if bits(t * cap > best) == 0:
                        alive &= ~(np.uint32(1) << np.uint32(block))
                        break
                store(state, block * STATE, t)
                store(state, block * STATE + 8, best)
                store(winners, block * 8, winner)
        if alive != 0 and not closing:
            copy_vectors(state, 0, states, tile * BLOCKS * STATE, BLOCKS * STATE // 8)
            copy_vectors(winners, 0, winner_states, tile * BLOCKS * 8, BLOCKS)
            live[tile] = alive
            continue
        live[tile] = 0
        for y in range(top, min(top + 16, height)):
            for x in range(left, min(left + 16, width)):
                block, lane = lane_at(x - left, y - top)
                row = winners[block * 8 + lane]
                dominant[y * width + x] = ids[row] if row >= 0 else np.int32(-1)
                weight[y * width + x] = state[block * STATE + 8 + lane]
