# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Weights summed by label for every pixel of a range of tiles.

Same split and same alpha as `composite_kernels`. The sums of a pixel lie side by side in the output, so eight pixels
are blended together and then add to their own sums one by one.
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
    splat,
    store,
)
from pipeline.render.tile_kernels import (
    BATCH,
    BLOCKS,
    alpha_of,
    blended,
    fill_batch,
    lane_at,
    new_batch,
    pixels_of,
    tile_corner,
)

# Floats per block in the state buffer: T.
STATE = 8


@kernel
def add_labels(
    first_tile, last_tile, edges, offsets, entries, records, ids, opening, closing,
    live, limits, states, labels, count, sums,
):  # fmt: skip
    """Add one slab's weights in tiles first_tile to last_tile of a band; the first arguments as in `composite`.

    Takes labels (M,) int32, 0 to count - 1, or negative for Gaussians that only hide what is behind them. Keeps states
    (tiles * 256,) float32 between slabs. Writes sums (h * W * count,) float32 for the h pixel rows of the band.
    """
    batch, rows, words, masks = new_batch()
    weights_of_lanes = np.empty(8, np.float32)
    zero, log2_alpha_min = splat(np.float32(0.0)), splat(limits[0])
    width, height = edges[2] - edges[0], edges[3] - edges[1]
    for tile in range(first_tile, last_tile):
        alive = live[tile]
        left, top, corner_x, corner_y = tile_corner(tile, edges)
        tile_state = tile * BLOCKS * STATE
        if opening:
            for place in range(BLOCKS * STATE):
                states[tile_state + place] = 0.0
            # Lanes beyond the image's edge keep T = -0 and take nothing.
            for y in range(top, min(top + 16, height)):
                for x in range(left, min(left + 16, width)):
                    block, lane = lane_at(x - left, y - top)
                    states[tile_state + block * STATE + lane] = 1.0
                    for place in range((y * width + x) * count, (y * width + x + 1) * count):
                        sums[place] = 0.0
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
                t = load(states, s)
                corner = (top + (block >> 2) * 2) * width + left + (block & 3) * 4
                while mask != 0:
                    entry = lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    a = alpha_of(batch, entry * RECORD, pixel_x, pixel_y, log2_alpha_min)
                    w, t, stops = blended(a, t)
                    label = np.int64(labels[ids[rows[entry]]])
                    lanes = bits(w > zero)
                    if label >= 0 and lanes != 0:
                        store(weights_of_lanes, 0, w)
                        while lanes != 0:
                            lane = lowest_bit(lanes)
                            lanes &= lanes - np.uint32(1)
                            pixel = corner + (lane >> 2) * width + (lane & 3)
                            sums[pixel * count + label] += at(weights_of_lanes, lane)
                    if bits(stops) != 0 and bits(t > zero) == 0:
                        alive &= ~(np.uint32(1) << np.uint32(block))
                        break
                store(states, s, t)
        live[tile] = np.uint32(0) if closing else alive
