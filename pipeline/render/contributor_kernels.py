# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The k heaviest Gaussians of every pixel, for a range of tiles.

Same split and same alpha as `composite_kernels`. The output itself holds the lists between slabs: a pixel's k places
are sorted by descending weight, and a heavier Gaussian is inserted from the end of what is there, behind its equals,
so that ties stay nearest first. Eight pixels are compared with the lightest of their lists at once; only pixels that
take a Gaussian leave vector code, and lists move up eight places at a time. A pixel is done when it has met `first`
contributions, or once 0.99 T, the most anything behind can weigh, does not beat the lightest of its list.
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
    store,
)
from pipeline.render.tile_kernels import (
    ALPHA_CAP,
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

# Floats per block in the state buffer: T, contributions met, lightest weight of the list.
STATE = 24


@kernel
def collect(
    first_tile, last_tile, edges, offsets, entries, records, ids, opening, closing,
    live, limits, states, k, first, found_ids, found_weights,
):  # fmt: skip
    """Insert one slab into the lists of tiles first_tile to last_tile of a band; the first arguments as in `composite`.

    Keeps states (tiles * 768,) float32 between slabs. Writes found_ids (H * W * k,) int32, -1 in empty places, and
    found_weights (H * W * k,) float32. `first` (float32, may be infinite) bounds the contributions a pixel looks at.
    """
    batch, rows, words, masks = new_batch()
    weights_of_lanes = np.empty(8, np.float32)
    zero, one, cap = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(ALPHA_CAP)
    log2_alpha_min, most = splat(limits[0]), splat(np.float32(first))
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
                    for place in range((y * width + x) * k, (y * width + x + 1) * k):
                        found_ids[place] = -1
                        found_weights[place] = 0.0
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
                t, met = load(states, s), load(states, s + 8)
                while mask != 0:
                    entry = lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    a = alpha_of(batch, entry * RECORD, pixel_x, pixel_y, log2_alpha_min)
                    w, t, _ = blended(a, t)
                    lanes = bits(w > load(states, s + 16))
                    if lanes != 0:
                        store(weights_of_lanes, 0, w)
                        store(states, s + 8, met)
                        gaussian = ids[rows[entry]]
                        while lanes != 0:
                            lane = lowest_bit(lanes)
                            lanes &= lanes - np.uint32(1)
                            weight = at(weights_of_lanes, lane)
                            x, y = left + (block & 3) * 4 + (lane & 3), top + (block >> 2) * 2 + (lane >> 2)
                            base = (y * width + x) * k
                            place = base + min(np.int64(states[s + 8 + lane]), k - 1)
                            wide = splat(weight)
                            while place - base >= 8:
                                lighter = load(found_weights, place - 8)
                                if bits(lighter < wide) != 255:
                                    break
                                store(found_weights, place - 7, lighter)
                                store(found_ids, place - 7, load(found_ids, place - 8))
                                place -= 8
                            while place > base and found_weights[place - 1] < weight:
                                found_weights[place] = found_weights[place - 1]
                                found_ids[place] = found_ids[place - 1]
                                place -= 1
                            found_weights[place] = weight
                            found_ids[place] = gaussian
                            states[s + 16 + lane] = found_weights[base + k - 1]
                    met = met + select(w > zero, one, zero)
                    t = select(met >= most, minus_magnitude(t), t)
                    if bits(t * cap > load(states, s + 16)) == 0:
                        alive &= ~(np.uint32(1) << np.uint32(block))
                        break
                store(states, s, t)
                store(states, s + 8, met)
        live[tile] = np.uint32(0) if closing else alive
