# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Other kernels than the renderer's own: tiles of 8 x 8 pixels, and 2^x by polynomials of another degree.

A variant takes the place of the renderer's functions in a process that has not drawn yet: kernels read the names of
their modules when they are compiled, at the first frame. Everything else stays as it is.
"""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit

from pipeline.render import project_kernels, tile_kernels, window
from pipeline.render.project_kernels import BOUND, INVERSE_MU, LOG2_OPACITY, MU, MV, NV, SLACK, SLOPE, U, V
from pipeline.render.simd_kernels import (
    at,
    fma,
    lane_numbers,
    larger,
    select,
    smaller,
    splat,
    splat_at,
    square_root,
    truncate,
    union,
)
from pipeline.render.tile_kernels import ALPHA_CAP, M_0, N_0

SIDE = 8
"""Pixels along a small tile."""
ALL_BLOCKS = 0x3333
"""Its blocks of 4 x 2 pixels keep the numbers they have in a tile of 16 x 16: two of every four, in four rows."""


def best_polynomial(degree: int) -> np.ndarray:
    """Coefficients, lowest first, of the p that is nearest to 2^(x/8) on [-8, 0] in relative error (Remez)."""
    grid = np.linspace(-1, 0, 20_001)
    y = -0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
    signs = (-1.0) ** np.arange(degree + 2)
    for _ in range(12):
        powers = y[:, None] ** np.arange(degree + 1)
        found = np.linalg.solve(np.c_[powers / np.exp2(y)[:, None], signs], np.ones(degree + 2))[:-1]
        error = np.polynomial.polynomial.polyval(grid, found) / np.exp2(grid) - 1
        parts = np.split(np.arange(len(grid)), np.flatnonzero(np.diff(np.sign(error)) != 0) + 1)
        peaks = [part[np.abs(error[part]).argmax()] for part in parts]
        if len(peaks) != degree + 2:  # the error no longer alternates: float64 is at its end
            break
        y = grid[peaks]
    return found / 8.0 ** np.arange(degree + 1)


def alpha_by_degree(degree: int) -> Callable:
    """Return `tile_kernels.alpha_of` with another polynomial."""
    highest_first = tuple(np.float32(c) for c in best_polynomial(degree)[::-1])

    @njit(error_model="numpy")
    def alpha_of(batch, e, pixel_x, pixel_y, log2_alpha_min):
        m = fma(splat_at(batch, e + MU), pixel_x, fma(splat_at(batch, e + MV), pixel_y, splat_at(batch, e + M_0)))
        n = fma(splat_at(batch, e + NV), pixel_y, splat_at(batch, e + N_0))
        x = fma(-m, m, fma(-n, n, splat_at(batch, e + LOG2_OPACITY)))
        p = splat(highest_first[0])
        for k in range(1, degree + 1):
            p = fma(x, p, splat(highest_first[k]))
        p = p * p
        p = p * p
        p = smaller(p * p, splat(ALPHA_CAP))
        return select(x >= log2_alpha_min, p, splat(np.float32(0.0)))

    return alpha_of


@njit(error_model="numpy")
def covered_blocks_of_small_tile(records, r, corner_x, corner_y):
    """Blocks of a tile of 8 x 8 that a record may touch: lane i holds pixel row i, so one vector has them all."""
    zero, limit = splat(np.float32(0.0)), splat(np.float32(SIDE))
    dy = lane_numbers() + splat(corner_y - at(records, r + V))
    n = splat_at(records, r + NV) * dy
    room = fma(-n, n, splat_at(records, r + BOUND))
    half = square_root(larger(room, zero)) * splat_at(records, r + INVERSE_MU)
    middle = fma(-splat_at(records, r + SLOPE), dy, splat(at(records, r + U) - corner_x))
    first, last = middle - half, middle + half + splat(SLACK)
    low = truncate(smaller(larger(first + splat(np.float32(1.0) - SLACK), zero), limit))
    high = truncate(smaller(larger(last, zero), splat(np.float32(SIDE - 1))))
    touched = (room >= zero) & (last >= zero) & (low <= high)
    two, one, no = splat(np.int32(2)), splat(np.int32(1)), splat(np.int32(0))
    nibble = (two << (high >> two)) - (one << (low >> two))
    return union(select(touched, nibble, no) << ((truncate(lane_numbers()) >> one) << two))


def band_of_small_tiles(window):
    """`Band.of` with tiles of 8 x 8: blocks beyond the image's edge want nothing."""
    from pipeline.render.binning import Band

    live = np.full((window.rows, window.columns), ALL_BLOCKS, np.uint32)
    if window.width - SIDE * (window.columns - 1) <= 4:
        live[:, -1] &= np.uint32(0x1111)
    rows_left = window.height - SIDE * (window.rows - 1)
    if rows_left < SIDE:
        live[-1] &= np.uint32((1 << (4 * -(-rows_left // 2))) - 1)
    return Band(window, live.reshape(-1))


@njit(error_model="numpy")
def small_tiles_in(edges):
    """`tiles_in` with tiles of 8 x 8."""
    return (edges[2] - edges[0] + SIDE - 1) // SIDE, (edges[3] - edges[1] + SIDE - 1) // SIDE


@njit(error_model="numpy")
def small_tile_corner(tile, edges):
    """`tile_corner` with tiles of 8 x 8."""
    columns, _ = small_tiles_in(edges)
    left, top = (tile % columns) * SIDE, (tile // columns) * SIDE
    return left, top, np.float32(edges[0] + left) + np.float32(0.5), np.float32(edges[1] + top) + np.float32(0.5)


def replace(module: object, **values: object) -> None:
    """Set names that a module has: a name that has moved must not leave the variant without effect."""
    for name, value in values.items():
        if not hasattr(module, name):
            sys.exit(f"the renderer has changed: {module} has no {name}")
        setattr(module, name, value)


def import_with_small_tiles(name: str) -> None:
    """Import a kernel module of the renderer whose loops over a tile's pixels hold its side as a number."""
    spec = importlib.util.find_spec(f"pipeline.render.{name}")
    source, times = re.subn(r"\b(top|left) \+ (?:16|TILE),", rf"\1 + {SIDE},", Path(spec.origin).read_text())
    if times != 2:
        sys.exit(f"the renderer has changed: {name} names the side of a tile {times} times")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    exec(compile(source, spec.origin, "exec"), module.__dict__)


def take_effect(tile: int, degree: int) -> None:
    """Make this process draw with tiles of 16 or 8 pixels and an exponential of a degree; 5 is the renderer's own."""
    if "pipeline.render.composite_kernels" in sys.modules:
        sys.exit("variants must be chosen before the first frame")
    if degree != 5:
        replace(tile_kernels, alpha_of=alpha_by_degree(degree))
    if tile == SIDE:
        replace(project_kernels, TILE_SHIFT=SIDE.bit_length() - 1, tiles_in=small_tiles_in)
        replace(
            tile_kernels,
            BLOCKS=ALL_BLOCKS.bit_length(),
            covered_blocks=covered_blocks_of_small_tile,
            tile_corner=small_tile_corner,
        )
        replace(window, TILE=SIDE)
        for name in ("composite_kernels", "dominance_kernels"):
            import_with_small_tiles(name)
        # What copies these names at import comes after them.
        from pipeline.render import passes
        from pipeline.render.binning import Band

        replace(Band, of=staticmethod(band_of_small_tiles))
        # The first slab stays as large as with tiles four times the size.
        replace(passes, SLAB_KEYS_PER_TILE=passes.SLAB_KEYS_PER_TILE // 4)
