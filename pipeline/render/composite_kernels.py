# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Front-to-back compositing of a range of tiles.

Work is split over ranges of tiles; a tile is one flat state buffer, and a block's transmittance, colour, depth and
largest weight stay in registers through a whole batch. An output that is not asked for is passed as None: numba then
compiles the kernel without it. A pixel that has stopped keeps its transmittance as a negative number.
"""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel
from pipeline.render.project_kernels import BLUE, DEPTH, GREEN, RECORD, RED
from pipeline.render.simd_kernels import (
    at,
    bits,
    fma,
    load,
    lowest_bit,
    minus_magnitude,
    select,
    splat,
    splat_at,
    store,
)
from pipeline.render.tile_kernels import (
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

# Floats per block in the state buffer: T, red, green, blue, depth, weight.
STATE = 48


@kernel
def composite(
    first_tile, last_tile, edges, offsets, entries, records, ids, opening, closing,
    live, limits, states, winner_states, t_stop, background, color, depth, alpha, dominant, weight,
):  # fmt: skip
    """Composite one slab of the depth order into tiles first_tile to last_tile of a band, and write finished ones.

    A band starts at tile row `first_row`. Takes offsets (tiles + 1,) int64 into entries (int32 records per tile,
    nearest first), records (rows * 16,) float32, ids (rows,) int32 Gaussians, limits (2,) float32 (see
    `RenderQuality.limits`), t_stop, the transmittance below which a pixel also stops, float32 or None, and background
    (3,) float32. Between slabs,
    live (tiles,) uint32 holds the blocks that still take records, states (tiles * 1536,) float32 and winner_states
    (tiles * 256,) int32 the rest. Tiles start afresh with the `opening` slab; a tile's pixels are written once, when
    all its blocks have stopped or with the `closing` slab: color (H * W * 3,), depth, alpha, weight (H * W,) float32
    and dominant (H * W,) int32, each of which may be None.
    """
    state = np.empty(BLOCKS * STATE, np.float32)
    winners = np.empty(BLOCKS * 8, np.int32)
    batch, rows, words, masks = new_batch()
    zero, log2_alpha_min = splat(np.float32(0.0)), splat(limits[0])
    width, height = edges[2] - edges[0], edges[3] - edges[1]
    for tile in range(first_tile, last_tile):
        alive = live[tile]
        if alive == 0 or (offsets[tile] == offsets[tile + 1] and not (opening or closing)):
            continue
        left, top, corner_x, corner_y = tile_corner(tile, edges)
        if opening:
            for block in range(BLOCKS):
                s = block * STATE
                store(state, s, splat(np.float32(1.0)))
                for field in range(1, 6):
                    store(state, s + field * 8, zero)
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
                s = block * STATE
                t = load(state, s)
                red, green, blue = load(state, s + 8), load(state, s + 16), load(state, s + 24)
                z_sum, best = load(state, s + 32), load(state, s + 40)
                winner = load(winners, block * 8)
                while mask != 0:
                    entry = lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    e = entry * RECORD
                    a = alpha_of(batch, e, pixel_x, pixel_y, log2_alpha_min)
                    w, t, stops = blended(a, t)
                    if t_stop is not None:
                        t = select(t < splat(t_stop), minus_magnitude(t), t)
                    if color is not None:
                        red = fma(w, splat_at(batch, e + RED), red)
                        green = fma(w, splat_at(batch, e + GREEN), green)
                        blue = fma(w, splat_at(batch, e + BLUE), blue)
                    if depth is not None:
                        z_sum = fma(w, splat_at(batch, e + DEPTH), z_sum)
                    if dominant is not None:
                        more = w > best
                        best = select(more, w, best)
                        winner = select(more, splat_at(rows, entry), winner)
                    if (t_stop is not None or bits(stops) != 0) and bits(t > zero) == 0:
                        alive &= ~(np.uint32(1) << np.uint32(block))
                        break
                store(state, s, t)
                store(state, s + 8, red)
                store(state, s + 16, green)
                store(state, s + 24, blue)
                store(state, s + 32, z_sum)
                store(state, s + 40, best)
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
                s = block * STATE + lane
                pixel = y * width + x
                t_here = abs(state[s])
                if color is not None:
                    for channel in range(3):
                        color[pixel * 3 + channel] = state[s + 8 + 8 * channel] + t_here * background[channel]
                if alpha is not None:
                    alpha[pixel] = np.float32(1.0) - t_here
                if depth is not None:
                    seen = np.float32(1.0) - t_here
                    depth[pixel] = state[s + 32] / seen if seen > 0 else np.float32(0.0)
                if dominant is not None:
                    winner_row = winners[block * 8 + lane]
                    dominant[pixel] = ids[winner_row] if winner_row >= 0 else np.int32(-1)
                    weight[pixel] = state[s + 40]
