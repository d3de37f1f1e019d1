# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Compositing that can be run backwards: what each pixel needs for that, and the way back to the records.

Forwards, work is split over ranges of tiles, as in `composite`, whose colours, alphas and stops these are bit by bit.
Kept for the way back are each pixel's final transmittance and the place, in its tile's list, of the record that stopped
it. Backwards, work is split over cells of 4 x 4 tiles: a record has one row of sums in every cell it reaches, which
only that cell's thread adds to, tile by tile, so that rows added up in order of the cells give the same bits whatever
the number of threads. Within a tile, records come last to first; the sums of a record stay in registers while it goes
through the blocks it covers.

For a pixel with gradients g, a record's light is s = c . g_color + g_alpha + z g_depth + g_inverse / z. Behind record i
lies S = sum of w s over the records behind it, plus the background's share; then
    dL/d alpha_i = T_i s_i - S / (1 - alpha_i),   T_i = T_(i+1) / (1 - alpha_i).
With h = alpha dL/d alpha, the gradient with respect to the exponent's m and n needs only the sums of h, hm, hn, hmm,
hmn and hnn. Where alpha is capped h is 0 (the function is flat there); what was cut off or came after the stop adds
nothing, so the jumps at these limits are not differentiated.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel
from pipeline.render.project_kernels import BLUE, DEPTH, GREEN, LOG2_OPACITY, MU, MV, NV, RECORD, RED, tiles_in
from pipeline.render.simd_kernels import (
    at,
    bits,
    fma,
    load,
    lowest_bit,
    prefetch,
    put,
    select,
    smaller,
    splat,
    splat_at,
    store,
)
from pipeline.render.tile_kernels import (
    ALPHA_CAP,
    BATCH,
    BLOCKS,
    E0,
    E1,
    E2,
    E3,
    E4,
    E5,
    M_0,
    N_0,
    PLACE,
    alpha_of,
    blended,
    copy_vectors,
    fill_batch,
    lane_at,
    new_batch,
    pixels_of,
    tile_corner,
)
from pipeline.render.transpose_kernels import lane_sums

STATE = 56
"""Floats per block between slabs: T, red, green, blue, depth, inverse depth, place of the stopping record."""
INVERSE_DEPTH = 14
"""Field of a record that only these kernels use."""
CELL_SHIFT = 2
"""A cell is 4 x 4 tiles: most records then lie in one, and 80 cells of a 640 x 480 image keep 16 threads busy."""
SUMS = 16
"""Floats in a row of sums, one cache line: those of H to B, and six that stay 0."""
H, HM, HN, HMM, HMN, HNN, Z, R, G, B = range(10)
NEVER = np.float32(np.inf)
"""Place of the stopping record of a pixel that none stopped. Places are float32: a tile lists up to 2^24 records."""
# Floats per block on the way back: T, S, six gradients, place of the stopping record, columns and rows of the pixels.
BACK = 88
GRADIENTS, STOP, PIXELS = 16, 64, 72


@kernel
def mark(touched, records, seen):
    """Write 1 / z of the touched records into their field for it, and 1 to their places of `seen` (rows,) uint8."""
    for k in range(touched.size):
        row = np.int64(touched[k])
        records[row * RECORD + INVERSE_DEPTH] = np.float32(1.0) / records[row * RECORD + DEPTH]
        seen[row] = 1


@kernel
def lay_out(rows, rectangles, bases, rows_of):
    """Give each record seen a row of sums in every cell its rectangle of tiles reaches; see `unblend` for `rows_of`.

    Writes bases (n + 1,) int64, where the rows of each begin.
    """
    base = np.int64(0)
    for k in range(rows.size):
        bases[k] = base
        across, down = rectangles[2 * rows[k]], rectangles[2 * rows[k] + 1]
        left, right = (across & 0xFFFF) >> CELL_SHIFT, (across >> 16) >> CELL_SHIFT
        upper, lower = (down & 0xFFFF) >> CELL_SHIFT, (down >> 16) >> CELL_SHIFT
        wide = right - left + 1
        rows_of[2 * rows[k]], rows_of[2 * rows[k] + 1] = base - upper * wide - left, wide
        base += wide * (lower - upper + 1)
    bases[rows.size] = base


@kernel
def blend(
    first_tile, last_tile, edges, offsets, entries, records, ids, opening, closing,
    live, limits, states, passed, background, color, alpha, depth, inverse_depth, through, stops_at,
):  # fmt: skip
    """Composite one slab into tiles first_tile to last_tile and write finished ones; arguments begin as `composite`'s.

    Between slabs, states (tiles * 1792,) float32 and passed (tiles,) int64, entries met, hold what live tiles need.
    Writes color (H * W * 3,), alpha, depth and inverse_depth (H * W,), the last two undivided sums and None where not
    wanted, and, block by block of each tile, through and stops_at (tiles * 256,), all float32.
    """
    state = np.empty(BLOCKS * STATE, np.float32)
    batch, rows, words, masks = new_batch()
    zero, log2_alpha_min = splat(np.float32(0.0)), splat(limits[0])
    width, height = edges[2] - edges[0], edges[3] - edges[1]
    for tile in range(first_tile, last_tile):
        alive = live[tile]
        if alive == 0 or (offsets[tile] == offsets[tile + 1] and not (opening or closing)):
            continue
        left, top, corner_x, corner_y = tile_corner(tile, edges)
        if opening:
            passed[tile] = 0
            for block in range(BLOCKS):
                s = block * STATE
                store(state, s, splat(np.float32(1.0)))
                for field in range(1, 6):
                    store(state, s + field * 8, zero)
                store(state, s + 48, splat(NEVER))
        else:
            copy_vectors(states, tile * BLOCKS * STATE, state, 0, BLOCKS * STATE // 8)
        begin, end = offsets[tile], offsets[tile + 1]
        while begin < end and alive != 0:
            stop = min(begin + BATCH, end)
            base = np.float32(passed[tile] + begin - offsets[tile])
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
                z_sum, inverse_sum = load(state, s + 32), load(state, s + 40)
                while mask != 0:
                    entry = lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    e = entry * RECORD
                    a = alpha_of(batch, e, pixel_x, pixel_y, log2_alpha_min)
                    before = t
                    w, t, stops = blended(a, t)
                    red = fma(w, splat_at(batch, e + RED), red)
                    green = fma(w, splat_at(batch, e + GREEN), green)
                    blue = fma(w, splat_at(batch, e + BLUE), blue)
                    if depth is not None:
                        z_sum = fma(w, splat_at(batch, e + DEPTH), z_sum)
                    if inverse_depth is not None:
                        inverse_sum = fma(w, splat_at(batch, e + INVERSE_DEPTH), inverse_sum)
                    if bits(stops) != 0:
                        stopped = stops & (before > zero)
                        place = splat(base + at(batch, e + PLACE))
                        store(state, s + 48, select(stopped, place, load(state, s + 48)))
                        if bits(t > zero) == 0:
                            alive &= ~(np.uint32(1) << np.uint32(block))
                            break
                store(state, s, t)
                store(state, s + 8, red)
                store(state, s + 16, green)
                store(state, s + 24, blue)
                store(state, s + 32, z_sum)
                store(state, s + 40, inverse_sum)
        passed[tile] += end - offsets[tile]
        if alive != 0 and not closing:
            copy_vectors(state, 0, states, tile * BLOCKS * STATE, BLOCKS * STATE // 8)
            live[tile] = alive
            continue
        live[tile] = 0
        for place in range(BLOCKS * 8):
            s = (place >> 3) * STATE + (place & 7)
            through[tile * BLOCKS * 8 + place] = abs(state[s])
            stops_at[tile * BLOCKS * 8 + place] = state[s + 48]
        for y in range(top, min(top + 16, height)):
            for x in range(left, min(left + 16, width)):
                block, lane = lane_at(x - left, y - top)
                s = block * STATE + lane
                pixel = y * width + x
                t_here = abs(state[s])
                for channel in range(3):
                    color[pixel * 3 + channel] = state[s + 8 + 8 * channel] + t_here * background[channel]
                alpha[pixel] = np.float32(1.0) - t_here
                if depth is not None:
                    depth[pixel] = state[s + 32]
                if inverse_depth is not None:
                    inverse_depth[pixel] = state[s + 40]


@njit(error_model="numpy")
def read_gradients(tile, edges, through, stops_at, background, g_color, g_alpha, g_depth, g_inverse, back, ends):
    """Fill a tile's state for the way back, and `ends`: the place before which each block has something to take.

    Blocks without a gradient have nothing to take, nor have lanes off the image. Returns whether any block has.
    """
    left, top, _, _ = tile_corner(tile, edges)
    width, height = edges[2] - edges[0], edges[3] - edges[1]
    zero = splat(np.float32(0.0))
    if left + 16 > width or top + 16 > height:
        for k in range(BLOCKS):
            for field in range(GRADIENTS, GRADIENTS + 48, 8):
                store(back, k * BACK + field, zero)
    for y in range(top, min(top + 16, height)):
        for x in range(left, min(left + 16, width)):
            block, lane = lane_at(x - left, y - top)
            s, pixel = block * BACK + GRADIENTS + lane, y * width + x
            put(back, s, at(g_color, 3 * pixel))
            put(back, s + 8, at(g_color, 3 * pixel + 1))
            put(back, s + 16, at(g_color, 3 * pixel + 2))
            put(back, s + 24, at(g_alpha, pixel))
            if g_depth is not None:
                put(back, s + 32, at(g_depth, pixel))
            if g_inverse is not None:
                put(back, s + 40, at(g_inverse, pixel))
    some = False
    for block in range(BLOCKS):
        s, place = block * BACK, (tile * BLOCKS + block) * 8
        t, stop = load(through, place), load(stops_at, place)
        red, green, blue = load(back, s + GRADIENTS), load(back, s + GRADIENTS + 8), load(back, s + GRADIENTS + 16)
        behind = fma(splat(background[0]), red, fma(splat(background[1]), green, splat(background[2]) * blue))
        store(back, s, t)
        store(back, s + 8, t * behind)
        store(back, s + STOP, stop)
        kept = (red >= zero) & (red <= zero) & (green >= zero) & (green <= zero) & (blue >= zero) & (blue <= zero)
        for field in range(24, 48, 8):
            if field == 24 or (field == 32 and g_depth is not None) or (field == 40 and g_inverse is not None):
                g = load(back, s + GRADIENTS + field)
                kept = kept & (g >= zero) & (g <= zero)
        ends[block] = np.float32(0.0)
        if bits(kept) != 255:
            some = True
            for lane in range(8):
                ends[block] = max(ends[block], at(back, s + STOP + lane))
    return some


@njit(error_model="numpy")
def blocks_before(ends, place):
    """Return the blocks that still have something to take at a place of the tile's list."""
    here, word = splat(place), np.uint32(0)
    for k in range(4):
        word |= bits(load(ends, 8 * k) > here) << np.uint32(8 * k)
    return word


@kernel
def unblend(
    first_cell, last_cell, edges, lists, entries, records, limits, wanted, through, stops_at, background,
    g_color, g_alpha, g_depth, g_inverse, rows_of, sums,
):  # fmt: skip
    """Add, for the tiles of cells first_cell to last_cell, each record's sums over its pixels to its row of the cell.

    Takes lists (slabs, tiles + 1) int64, where each tile's entries of each slab begin, wanted (tiles,) bool, the
    images' gradients, shaped as the images (g_depth and g_inverse may be None), and rows_of (rows * 2,) int64: a
    record's row in cell (column, row) is the first number + row * the second + column. Adds to sums (n * 16,) float32.
    """
    batch, rows, words, masks = new_batch()
    back, ends, slots = np.empty(BLOCKS * BACK, np.float32), np.empty(BLOCKS, np.float32), np.empty(BATCH, np.int64)
    for block in range(BLOCKS):
        pixel_x, pixel_y = pixels_of(block)
        store(back, block * BACK + PIXELS, pixel_x)
        store(back, block * BACK + PIXELS + 8, pixel_y)
    columns, tile_rows = tiles_in(edges)
    cell_columns = ((columns - 1) >> CELL_SHIFT) + 1
    slabs = lists.shape[0]
    for cell in range(first_cell, last_cell):
        cell_row, cell_column = cell // cell_columns, cell % cell_columns
        row_end = min((cell_row + 1) << CELL_SHIFT, tile_rows)
        column_end = min((cell_column + 1) << CELL_SHIFT, columns)
        for tile_row in range(cell_row << CELL_SHIFT, row_end):
            for tile in range(tile_row * columns + (cell_column << CELL_SHIFT), tile_row * columns + column_end):
                total = np.int64(0)
                for slab in range(slabs):
                    total += lists[slab, tile + 1] - lists[slab, tile]
                if (
                    total == 0
                    or not wanted[tile]
                    or not read_gradients(
                        tile, edges, through, stops_at, background, g_color, g_alpha, g_depth, g_inverse, back, ends
                    )
                ):
                    continue
                _, _, corner_x, corner_y = tile_corner(tile, edges)
                for slab in range(slabs - 1, -1, -1):
                    begin, stop = lists[slab, tile], lists[slab, tile + 1]
                    total -= stop - begin
                    while stop > begin:
                        start = max(begin, stop - BATCH)
                        base = np.float32(total + start - begin)
                        alive = blocks_before(ends, base)
                        if alive != 0:
                            fill_batch(
                                records, entries, start, stop, corner_x, corner_y, alive, batch, rows, words, masks
                            )
                            for k in range(BATCH):
                                if at(words, k) != 0:
                                    r = np.int64(at(rows, k)) * 2
                                    slot = at(rows_of, r) + cell_row * at(rows_of, r + 1) + cell_column
                                    put(slots, k, slot * SUMS)
                                    prefetch(sums, slot * SUMS)
                            for k in range(BATCH - 1, -1, -1):
                                word = at(words, k) & blocks_before(ends, base + at(batch, k * RECORD + PLACE))
                                if word != 0:
                                    unblend_record(
                                        batch, k * RECORD, word, base, limits[0], g_depth, g_inverse, back,
                                        sums, at(slots, k),
                                    )  # fmt: skip
                        stop = start


@njit(error_model="numpy")
def unblend_record(batch, e, word, base, cut, g_depth, g_inverse, back, sums, row):
    """Take one record out of the blocks of `word`, and add its sums over their pixels to `sums[row:]`."""
    zero, one, cap, log2_alpha_min = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(ALPHA_CAP), splat(cut)
    mu, mv, nv = splat_at(batch, e + MU), splat_at(batch, e + MV), splat_at(batch, e + NV)
    m_0, n_0, exponent = splat_at(batch, e + M_0), splat_at(batch, e + N_0), splat_at(batch, e + LOG2_OPACITY)
    red, green, blue = splat_at(batch, e + RED), splat_at(batch, e + GREEN), splat_at(batch, e + BLUE)
    z, inverse_z = splat_at(batch, e + DEPTH), splat_at(batch, e + INVERSE_DEPTH)
    minus_square = -(inverse_z * inverse_z)
    place = splat(base + at(batch, e + PLACE))
    sum_h, sum_hm, sum_hn, sum_hmm, sum_hmn, sum_hnn = zero, zero, zero, zero, zero, zero
    sum_z, sum_r, sum_g, sum_b = zero, zero, zero, zero
    while word != 0:
        block = lowest_bit(word)
        word &= word - np.uint32(1)
        s = block * BACK
        pixel_x, pixel_y = load(back, s + PIXELS), load(back, s + PIXELS + 8)
        # Bit by bit the alpha of `alpha_of`.
        m = fma(mu, pixel_x, fma(mv, pixel_y, m_0))
        n = fma(nv, pixel_y, n_0)
        x = fma(-m, m, fma(-n, n, exponent))
        p = fma(x, fma(x, fma(x, fma(x, fma(x, splat(E5), splat(E4)), splat(E3)), splat(E2)), splat(E1)), splat(E0))
        p = p * p
        p = p * p
        p = p * p
        counts = (x >= log2_alpha_min) & (place < load(back, s + STOP))
        a = select(counts, smaller(p, cap), zero)
        steepness = select(p <= cap, a, zero)
        over = one / (one - a)
        t = load(back, s) * over
        behind = load(back, s + 8)
        gr, gg, gb = load(back, s + 16), load(back, s + 24), load(back, s + 32)
        light = fma(red, gr, fma(green, gg, fma(blue, gb, load(back, s + 40))))
        w = a * t
        if g_depth is not None:
            g = load(back, s + 48)
            light = fma(z, g, light)
            sum_z = fma(w, g, sum_z)
        if g_inverse is not None:
            g = load(back, s + 56)
            light = fma(inverse_z, g, light)
            sum_z = fma(w * minus_square, g, sum_z)
        h = steepness * fma(t, light, -(behind * over))
        store(back, s, t)
        store(back, s + 8, fma(w, light, behind))
        sum_r, sum_g, sum_b = fma(w, gr, sum_r), fma(w, gg, sum_g), fma(w, gb, sum_b)
        hm, hn = h * m, h * n
        sum_h, sum_hm, sum_hn = sum_h + h, sum_hm + hm, sum_hn + hn
        sum_hmm, sum_hmn, sum_hnn = fma(hm, m, sum_hmm), fma(hm, n, sum_hmn), fma(hn, n, sum_hnn)
    first = lane_sums(sum_h, sum_hm, sum_hn, sum_hmm, sum_hmn, sum_hnn, sum_z, sum_r)
    store(sums, row, load(sums, row) + first)
    store(sums, row + 8, load(sums, row + 8) + lane_sums(sum_g, sum_b, zero, zero, zero, zero, zero, zero))
