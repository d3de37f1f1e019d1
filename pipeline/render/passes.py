"""The phases of one frame, in order: cull blocks, project, sort, bin, shade, composite. Loops live in the kernels."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from jaxtyping import Float32, Int32, Int64, UInt64

from pipeline.geometry import Camera
from pipeline.render.bin_kernels import TILE, list_tiles, scatter
from pipeline.render.composite_kernels import composite
from pipeline.render.dominance_kernels import dominate
from pipeline.render.lens import Lens
from pipeline.render.prepare import BLOCK, PreparedGaussians
from pipeline.render.project_kernels import RECORD, project
from pipeline.render.rendering import Rendering
from pipeline.render.sh_kernels import shade
from pipeline.render.sort_kernels import order_ties, put_depths, put_ids, sort_upper_half
from pipeline.render.threads import run_each, split

WIDEST_BOUND = 3.34
"""Just over sqrt(2 ln 255): standard deviations at which a Gaussian of opacity 1 falls to alpha 1/255."""
LOW_PASS_PX = 0.55
"""Just over sqrt(0.3): what the low-pass adds to a projected deviation, at most."""
LARGEST_ENTRIES = 1 << 28
"""Tile entries held at a time (1 GiB); frames with more are composited in bands of tile rows."""
PIECES_PER_THREAD = 8
"""Pieces a phase is cut into per thread, so that a thread with easy tiles takes more of them."""


@dataclass(frozen=True, slots=True)
class FrameStatistics:
    """What a frame cost: filled in when a caller asks `render_frame` for it."""

    milliseconds: dict[str, float] = field(default_factory=dict)
    """Wall milliseconds by phase: cull, project, sort, bin, shade, composite."""
    counts: dict[str, int] = field(default_factory=dict)
    """Blocks visible, records (Gaussians kept) and tile entries."""


@dataclass(frozen=True, slots=True)
class _Records:
    """Projected survivors, in stretches of one table."""

    table: Float32[np.ndarray, "floats"]
    ids: Int32[np.ndarray, "rows"]
    stretches: tuple[tuple[int, int], ...]

    @property
    def count(self) -> int:
        return sum(end - start for start, end in self.stretches)


def render_frame(
    prepared: PreparedGaussians,
    camera: Camera,
    outputs: frozenset[str],
    *,
    background: tuple[float, float, float],
    near: float,
    sh_degree: int,
    antialias: bool,
    threads: int,
    statistics: FrameStatistics | None = None,
) -> Rendering:
    """Return the outputs of one view; arguments are as in `render`, already checked."""
    clock = _Clock(statistics)
    lens = Lens.of(camera)
    blocks = visible_blocks(prepared, camera, lens, near)
    clock.lap("cull")
    records = _project(prepared, camera, lens, blocks, near, antialias, threads)
    clock.lap("project")
    keys = _depth_order(records)
    clock.lap("sort")
    if "color" in outputs:
        _shade(prepared, lens, records, sh_degree, threads)
        clock.lap("shade")
    images = _Images.empty(camera, outputs)
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    first_row, entries = 0, 0
    while first_row < rows:
        band = _bin(records, keys, camera, first_row, rows, columns)
        clock.lap("bin")
        _composite(band, records, camera, images, background, columns, threads)
        clock.lap("composite")
        first_row, entries = band.last_row, entries + len(band.entries)
    clock.count(blocks=len(blocks), records=records.count, entries=entries)
    return images.rendering(camera)


def visible_blocks(prepared: PreparedGaussians, camera: Camera, lens: Lens, near: float) -> Int32[np.ndarray, "b"]:
    """Return the blocks that may hold a Gaussian this camera sees, ascending; never leaves one out.

    A Gaussian reaches pixel 0 only if fx X + cx Z + k (s fx sqrt(1 + l^2) + Z sqrt(.3)) >= 0, with s its largest
    deviation, l the clamp limit and k the widest bound. That is a plane in camera space shifted by the block's reach;
    likewise for the other three sides.
    """
    local = (prepared.block_centers - lens.center) @ lens.rotation.T
    spread = WIDEST_BOUND * LOW_PASS_PX
    (fx, fy), (cx, cy) = lens.focal, lens.principal
    reach_x = WIDEST_BOUND * fx * np.hypot(1.0, max(map(abs, lens.x_limits)))
    reach_y = WIDEST_BOUND * fy * np.hypot(1.0, max(map(abs, lens.y_limits)))
    sides = (
        ((0.0, 0.0, 1.0), -near, 0.0),
        ((fx, 0.0, cx + spread), 0.0, reach_x),
        ((-fx, 0.0, camera.width - cx + spread), 0.0, reach_x),
        ((0.0, fy, cy + spread), 0.0, reach_y),
        ((0.0, -fy, camera.height - cy + spread), 0.0, reach_y),
    )
    kept = np.ones(len(local), bool)
    for normal, offset, reach in sides:
        largest = local @ np.array(normal) + prepared.block_halves @ np.abs(np.array(normal) @ lens.rotation)
        # A relative hair keeps blocks that float64 rounding would put just outside.
        kept &= largest + offset + reach * prepared.block_reach >= -1e-9 * (1.0 + np.abs(local).max(axis=1))
    return np.flatnonzero(kept).astype(np.int32)


def _project(
    prepared: PreparedGaussians,
    camera: Camera,
    lens: Lens,
    blocks: Int32[np.ndarray, "b"],
    near: float,
    antialias: bool,
    threads: int,
) -> _Records:
    table = np.empty(len(blocks) * BLOCK * RECORD, np.float32)
    ids = np.empty(len(blocks) * BLOCK, np.int32)
    pieces = split(len(blocks), 1 if threads == 1 else threads * PIECES_PER_THREAD)
    ends = [0] * len(pieces)
    packed, geometry = lens.packed(near), prepared.geometry.reshape(-1)

    def work(k: int) -> None:
        first, last = pieces[k]
        ends[k] = project(
            geometry, prepared.ids, blocks, first, last, packed, camera.width, camera.height, antialias,
            table, ids, first * BLOCK,
        )  # fmt: skip

    run_each(work, len(pieces), threads)
    return _Records(table, ids, tuple((first * BLOCK, end) for (first, _), end in zip(pieces, ends, strict=True)))


def _depth_order(records: _Records) -> UInt64[np.ndarray, "n"]:
    """Return depth bits << 32 | row, nearest first, ties by Gaussian id."""
    rows = [np.arange(start, end, dtype=np.uint64) for start, end in records.stretches]
    keys = np.concatenate(rows) if rows else np.empty(0, np.uint64)
    spare = np.empty_like(keys)
    put_depths(records.table, keys)
    ordered = sort_upper_half(keys, spare)
    if order_ties(ordered, records.ids):
        return ordered
    # Many equal depths: sort by id first; the sort by depth that follows is stable.
    put_ids(records.ids, keys)
    ordered = sort_upper_half(keys, spare)
    put_depths(records.table, ordered)
    return sort_upper_half(ordered, keys if ordered is spare else spare)


@dataclass(frozen=True, slots=True)
class _Band:
    """Tile rows first_row to last_row and the records of each of their tiles, nearest first."""

    first_row: int
    last_row: int
    offsets: Int64[np.ndarray, "offsets"]
    entries: Int32[np.ndarray, "entries"]


def _bin(
    records: _Records, keys: UInt64[np.ndarray, "n"], camera: Camera, first_row: int, rows: int, columns: int
) -> _Band:
    """Return the next band: all remaining rows, or fewer where they would hold too many entries."""
    starts = np.empty(len(records.ids) + 1, np.int64)
    tiles = np.empty(4 * records.count + 64, np.int32)
    last_row = rows
    while True:
        counts = np.zeros((last_row - first_row) * columns, np.int64)
        used, fits = 0, True
        for start, end in records.stretches:
            at = start
            while True:
                at = list_tiles(
                    records.table, at, end, camera.width, camera.height, first_row, last_row, columns,
                    starts, tiles, used, counts,
                )  # fmt: skip
                used = int(starts[at])
                if at == end:
                    break
                if len(tiles) > LARGEST_ENTRIES and last_row - first_row > 1:
                    fits = False
                    break
                # One record may touch every tile of the band.
                tiles = np.concatenate([tiles, np.empty(max(len(tiles), len(counts)), np.int32)])
            if not fits:
                break
        if fits:
            break
        last_row = first_row + (last_row - first_row) // 2
    offsets = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
    entries = np.empty(used, np.int32)
    scatter(keys, starts, tiles, offsets[:-1].copy(), entries)
    return _Band(first_row, last_row, offsets, entries)


def _shade(prepared: PreparedGaussians, lens: Lens, records: _Records, degree: int, threads: int) -> None:
    sh, means = prepared.sh.reshape(-1), prepared.means.reshape(-1)
    coefficients = prepared.sh.shape[1]

    def work(k: int) -> None:
        first, last = records.stretches[k]
        shade(sh, coefficients, means, degree, lens.center, records.ids, first, last, records.table)

    run_each(work, len(records.stretches), threads)


@dataclass(frozen=True, slots=True)
class _Images:
    """Flat output arrays; None where an output is not asked for."""

    color: Float32[np.ndarray, "n3"] | None
    depth: Float32[np.ndarray, "n"] | None
    alpha: Float32[np.ndarray, "n"] | None
    dominant: Int32[np.ndarray, "n"] | None
    weight: Float32[np.ndarray, "n"] | None

    @staticmethod
    def empty(camera: Camera, outputs: frozenset[str]) -> _Images:
        pixels = camera.width * camera.height
        return _Images(
            color=np.empty(pixels * 3, np.float32) if "color" in outputs else None,
            depth=np.empty(pixels, np.float32) if "depth" in outputs else None,
            alpha=np.empty(pixels, np.float32) if "alpha" in outputs else None,
            dominant=np.empty(pixels, np.int32) if "dominant" in outputs else None,
            weight=np.empty(pixels, np.float32) if "dominant" in outputs else None,
        )

    def rendering(self, camera: Camera) -> Rendering:
        shape = (camera.height, camera.width)
        return Rendering(
            color=None if self.color is None else self.color.reshape(*shape, 3),
            depth=None if self.depth is None else self.depth.reshape(shape),
            alpha=None if self.alpha is None else self.alpha.reshape(shape),
            dominant=None if self.dominant is None else self.dominant.reshape(shape),
            dominant_weight=None if self.weight is None else self.weight.reshape(shape),
        )


def _composite(
    band: _Band,
    records: _Records,
    camera: Camera,
    images: _Images,
    background: tuple[float, float, float],
    columns: int,
    threads: int,
) -> None:
    number = len(band.offsets) - 1
    pieces = split(number, 1 if threads == 1 else threads * PIECES_PER_THREAD)
    behind = np.array(background, np.float32)
    dominance_only = images.color is None and images.depth is None and images.alpha is None

    def work(k: int) -> None:
        first, last = pieces[k]
        place = (first, last, columns, band.first_row, camera.width, camera.height)
        lists = (band.offsets, band.entries, records.table, records.ids)
        if dominance_only:
            dominate(*place, *lists, images.dominant, images.weight)
        else:
            composite(*place, *lists, behind, images.color, images.depth, images.alpha, images.dominant, images.weight)

    run_each(work, len(pieces), threads)


class _Clock:
    """Adds the time since the last lap to a phase; does nothing without statistics."""

    def __init__(self, statistics: FrameStatistics | None) -> None:
        self._statistics, self._start = statistics, perf_counter()

    def lap(self, phase: str) -> None:
        if self._statistics is not None:
            now = perf_counter()
            spent = self._statistics.milliseconds
            spent[phase] = spent.get(phase, 0.0) + 1e3 * (now - self._start)
            self._start = now

    def count(self, **counts: int) -> None:
        if self._statistics is not None:
            self._statistics.counts.update(counts)
