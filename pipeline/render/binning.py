"""A slab of the depth order sorted into tiles: the next records, for the tiles that still want some."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32, Int64, UInt32, UInt64

from pipeline.render.bin_kernels import list_tiles, scatter
from pipeline.render.threads import run_each, split
from pipeline.render.window import TILE, Window
from pipeline.render.workspace import WORKSPACE


@dataclass(frozen=True, slots=True)
class Records:
    """Projected survivors in stretches of one table, and their depth order."""

    table: Float32[np.ndarray, "floats"]
    """Sixteen numbers per record (project_kernels)."""
    rectangles: Int32[np.ndarray, "halves"]
    """Two words per record: first and last tile column, then row, in 16 bits each."""
    ids: Int32[np.ndarray, "rows"]
    """Index in the scene of each record's Gaussian."""
    keys: UInt64[np.ndarray, "n"]
    """Depth bits << 32 | row, nearest first, ties by Gaussian id."""


@dataclass(frozen=True, slots=True)
class Band:
    """Rows of tiles that are composited together, and what they still want."""

    window: Window
    """Where they lie in the image."""
    live: UInt32[np.ndarray, "tiles"]
    """Blocks of each tile that still take records; kernels clear it as pixels stop."""

    @staticmethod
    def of(window: Window) -> Band:
        """Return a fresh band; blocks beyond the image's edge want nothing."""
        live = np.full((window.rows, window.columns), 0xFFFFFFFF, np.uint32)
        columns_left, rows_left = window.width - TILE * (window.columns - 1), window.height - TILE * (window.rows - 1)
        live[:, -1] &= np.uint32(sum(0x11111111 << k for k in range(-(-columns_left // 4))))
        if rows_left < TILE:
            live[-1] &= np.uint32((1 << (4 * -(-rows_left // 2))) - 1)
        return Band(window, live.reshape(-1))


@dataclass(frozen=True, slots=True)
class Slab:
    """Keys up to `last`, sorted into the tiles of a band."""

    last: int
    """The key after the slab's last."""
    offsets: Int64[np.ndarray, "offsets"]
    """Where each tile's entries begin; one more than there are tiles."""
    entries: Int32[np.ndarray, "entries"]
    """Records, tile by tile, nearest first."""
    touched: tuple[Int32[np.ndarray, "_"], ...]
    """Records with at least one entry, each once."""


def bin_slab(records: Records, band: Band, first: int, size: int, threads: int) -> Slab:
    """Return the slab of up to `size` keys from `first` on.

    It ends early where its pairs would not fit: then the next slab goes on from there.
    """
    tiles = len(band.live)
    last = min(first + size, len(records.keys))
    pieces = [(first + a, first + b) for a, b in split(last - first, threads)]
    # Room for four tiles per key or many large records, and one record more that may touch every tile.
    pairs = [WORKSPACE.array(f"pairs {k}", 4 * (b - a) + 128 * tiles, np.uint64) for k, (a, b) in enumerate(pieces)]
    touched = [WORKSPACE.array(f"touched {k}", b - a, np.int32) for k, (a, b) in enumerate(pieces)]
    counts = np.zeros((len(pieces), tiles), np.int64)
    ends = np.zeros((len(pieces), 3), np.int64)

    live = band.live.reshape(-1, band.window.columns) != 0
    live_sums = np.zeros((live.shape[0] + 1, live.shape[1] + 1), np.int32)
    live.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32, out=live_sums[1:, 1:])
    live_sums = live_sums.reshape(-1)

    def list_piece(k: int) -> None:
        a, b = pieces[k]
        list_tiles(
            records.keys, a, b, records.table, records.rectangles, band.window.edges, band.live, live_sums,
            pairs[k], counts[k], touched[k], ends[k],
        )  # fmt: skip

    run_each(list_piece, len(pieces), threads)
    whole = next((k for k in range(len(pieces)) if ends[k, 0] < pieces[k][1]), len(pieces) - 1) + 1
    counts, last = counts[:whole], int(ends[whole - 1, 0]) if whole else last
    offsets = np.zeros(tiles + 1, np.int64)
    np.cumsum(counts.sum(axis=0), out=offsets[1:])
    entries = WORKSPACE.array("entries", int(offsets[-1]), np.int32)
    cursors = offsets[:-1] + np.cumsum(counts, axis=0) - counts

    def scatter_piece(k: int) -> None:
        scatter(pairs[k], ends[k, 1], cursors[k], entries)

    run_each(scatter_piece, whole, threads)
    return Slab(last, offsets, entries, tuple(touched[k][: ends[k, 2]] for k in range(whole)))
