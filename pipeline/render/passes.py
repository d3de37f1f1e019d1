"""The phases of one frame, in order: cull blocks, project, sort, then slab by slab bin, shade and composite.

A slab is the next part of the depth order. Tiles whose pixels have all stopped drop out between slabs, so what lies
behind them is neither binned nor coloured. Images too large for their state are cut into bands of tile rows. Neither
changes any bit of the result: a tile sees the same records in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from time import perf_counter, thread_time

import numpy as np
from jaxtyping import Float32, Int32

from pipeline.geometry import Camera
from pipeline.render.binning import Band, Records, Slab, bin_slab
from pipeline.render.composite_kernels import STATE, composite
from pipeline.render.culling import visible_blocks
from pipeline.render.dominance_kernels import STATE as DOMINANCE_STATE
from pipeline.render.dominance_kernels import dominate
from pipeline.render.lens import Lens
from pipeline.render.prepare import BLOCK, PreparedGaussians
from pipeline.render.project_kernels import RECORD, project
from pipeline.render.quality import EXACT, RenderQuality
from pipeline.render.rendering import Rendering
from pipeline.render.sh_kernels import shade
from pipeline.render.sort_kernels import order_ties, put_depths, put_ids, sort_upper_half
from pipeline.render.threads import run_each, split
from pipeline.render.tile_kernels import BLOCKS
from pipeline.render.window import Tiles, Window
from pipeline.render.workspace import WORKSPACE

SLAB_KEYS_PER_TILE = 64
"""Keys in the first slab per tile of the band: small slabs skip more hidden records, large ones cost less each."""
SLAB_GROWTH = 2
"""Each slab is this much larger than the last: most tiles are finished by the first ones."""
SMALLEST_SLAB, LARGEST_SLAB = 1 << 12, 1 << 19
"""Keys below which a slab is not worth its fixed cost, and above which its lists (32 bytes a key) grow too large."""
BAND_TILES = 1 << 15
"""Tiles composited at a time: their state takes 230 MB at most."""
PIECES_PER_THREAD = 8
"""Pieces a phase is cut into per thread, so that a thread with easy tiles takes more of them."""


@dataclass(frozen=True, slots=True)
class FrameStatistics:
    """What a frame cost: filled in when a caller asks `render_frame` for it."""

    milliseconds: dict[str, float] = field(default_factory=dict)
    """By phase (cull, project, sort, bin, shade, composite): CPU milliseconds with one thread, wall with more."""
    counts: dict[str, int] = field(default_factory=dict)
    """Blocks visible, records (Gaussians kept), slabs, tile entries and records with an entry."""


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
    quality: RenderQuality = EXACT,
    window: Tiles | None = None,
    statistics: FrameStatistics | None = None,
) -> Rendering:
    """Return the outputs of one view; arguments are as in `render`, already checked but for `window`.

    Of `quality`, the scale and the degree are the caller's to apply.
    """
    part = Window.of(camera, window)
    clock = Clock(statistics, threads)
    packed = Lens.of(camera).packed(near)
    records = sorted_records(
        prepared, camera, part, near=near, antialias=antialias, quality=quality, threads=threads, clock=clock
    )
    images = _Images.empty(part, outputs, background)
    state = DOMINANCE_STATE if images.dominance_only else STATE
    for step in steps(records, part, threads, clock):
        states = WORKSPACE.array("states", len(step.band.live) * BLOCKS * state, np.float32)
        winners = WORKSPACE.array("winners", len(step.band.live) * BLOCKS * 8, np.int32)
        if images.color is not None:
            _shade(prepared, packed, records, step.slab, sh_degree, threads)
            clock.lap("shade")
        _composite(step, records, quality, images.rows(part, step.band.window), states, winners, threads)
        clock.lap("composite")
    return images.rendering(part)


def sorted_records(
    prepared: PreparedGaussians,
    camera: Camera,
    window: Window,
    *,
    near: float,
    antialias: bool,
    quality: RenderQuality,
    threads: int,
    clock: Clock,
) -> Records:
    """Return the Gaussians this window of the camera's image shows, projected and in depth order."""
    lens = Lens.of(camera)
    blocks = visible_blocks(prepared, lens, window, near)
    clock.lap("cull")
    table, rectangles, ids, keys = _project(
        prepared, window, lens.packed(near), quality.limits(), blocks, antialias, threads
    )
    clock.lap("project")
    records = Records(table, rectangles, ids, _depth_order(table, ids, keys))
    clock.lap("sort")
    clock.count(blocks=len(blocks), records=len(records.keys))
    return records


@dataclass(frozen=True, slots=True)
class Step:
    """One slab to composite into the tiles of one band."""

    slab: Slab
    """The records, by tile."""
    band: Band
    """The tiles; the kernel clears `live` where a tile needs no more slabs."""
    opening: bool
    """Whether this is the band's first slab."""
    closing: bool
    """Whether no record is left after it."""

    def paint(self, work: Callable[[int, int], None], threads: int) -> None:
        """Call `work` for ranges of the band's tiles that cover them all, on `threads` threads."""
        pieces = split(len(self.band.live), 1 if threads == 1 else threads * PIECES_PER_THREAD)
        run_each(lambda k: work(*pieces[k]), len(pieces), threads)

    def arguments(self, first: int, last: int, records: Records) -> tuple[object, ...]:
        """Return what every compositing kernel takes first, up to and including `live`."""
        band, slab = self.band, self.slab
        return (
            first, last, band.window.edges, slab.offsets, slab.entries, records.table, records.ids,
            self.opening, self.closing, band.live,
        )  # fmt: skip


def steps(
    records: Records, window: Window, threads: int, clock: Clock, *, band_tiles: int | None = None
) -> Iterator[Step]:
    """Yield the slabs of every band in order, until no tile of it is live; composite one before asking for the next.

    Args:
        records: What the window shows.
        window: The part of the image to cover.
        threads: Threads that bin.
        clock: Counts and times the binning.
        band_tiles: Tiles a band holds, at least one row; None for `BAND_TILES`.
    """
    band_rows = max(1, (BAND_TILES if band_tiles is None else band_tiles) // window.columns)
    for first_row in range(0, window.rows, band_rows):
        band = Band.of(window.band(first_row, first_row + band_rows))
        size = min(max(SMALLEST_SLAB, SLAB_KEYS_PER_TILE * len(band.live)), LARGEST_SLAB)
        at, opening = 0, True
        while band.live.any():
            slab = bin_slab(records, band, at, size, threads)
            clock.lap("bin")
            clock.count(slabs=1, entries=len(slab.entries), touched=sum(map(len, slab.touched)))
            yield Step(slab, band, opening, closing=slab.last == len(records.keys))
            at, opening, size = slab.last, False, min(size * SLAB_GROWTH, LARGEST_SLAB)


def _project(
    prepared: PreparedGaussians,
    window: Window,
    packed: np.ndarray,
    limits: np.ndarray,
    blocks: Int32[np.ndarray, "b"],
    antialias: bool,
    threads: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the table of records, their rectangles of tiles, their ids, and unsorted depth keys."""
    rows = len(blocks) * BLOCK
    table = WORKSPACE.array("records", rows * RECORD, np.float32)
    rectangles = WORKSPACE.array("rectangles", rows * 2, np.int32)
    ids, keys = WORKSPACE.array("ids", rows, np.int32), WORKSPACE.array("keys", rows, np.uint64)
    pieces = split(len(blocks), 1 if threads == 1 else threads * PIECES_PER_THREAD)
    ends = [0] * len(pieces)
    geometry = prepared.geometry.reshape(-1)

    def work(k: int) -> None:
        first, last = pieces[k]
        ends[k] = project(
            geometry, prepared.ids, blocks, first, last, packed, limits, window.edges, antialias,
            table, rectangles, ids, keys, first * BLOCK,
        )  # fmt: skip

    run_each(work, len(pieces), threads)
    written = [keys[first * BLOCK : end] for (first, _), end in zip(pieces, ends, strict=True)]
    return table, rectangles, ids, written[0] if len(written) == 1 else np.concatenate([keys[:0], *written])


def _depth_order(table: np.ndarray, ids: np.ndarray, keys: np.ndarray) -> np.ndarray:
    """Return the keys sorted by depth, ties by Gaussian id."""
    spare = WORKSPACE.array("spare keys", len(keys), np.uint64)
    ordered = sort_upper_half(keys, spare)
    if order_ties(ordered, ids):
        return ordered
    # Many equal depths: sort by id first; the sort by depth that follows is stable.
    put_ids(ids, keys)
    ordered = sort_upper_half(keys, spare)
    put_depths(table, ordered)
    return sort_upper_half(ordered, keys if ordered is spare else spare)


def _shade(
    prepared: PreparedGaussians, packed: np.ndarray, records: Records, slab: Slab, degree: int, threads: int
) -> None:
    sh, coefficients = prepared.sh.reshape(-1), prepared.sh.shape[1]

    def work(k: int) -> None:
        touched = slab.touched[k]
        shade(sh, coefficients, degree, packed, records.ids, touched, len(touched), records.table)

    run_each(work, len(slab.touched), threads)


@dataclass(frozen=True, slots=True)
class _Images:
    """Flat output arrays of some rows; None where an output is not asked for."""

    background: Float32[np.ndarray, "3"]
    color: Float32[np.ndarray, "n3"] | None
    depth: Float32[np.ndarray, "n"] | None
    alpha: Float32[np.ndarray, "n"] | None
    dominant: Int32[np.ndarray, "n"] | None
    weight: Float32[np.ndarray, "n"] | None

    @staticmethod
    def empty(window: Window, outputs: frozenset[str], background: tuple[float, float, float]) -> _Images:
        pixels = window.width * window.height
        return _Images(
            background=np.array(background, np.float32),
            color=np.empty(pixels * 3, np.float32) if "color" in outputs else None,
            depth=np.empty(pixels, np.float32) if "depth" in outputs else None,
            alpha=np.empty(pixels, np.float32) if "alpha" in outputs else None,
            dominant=np.empty(pixels, np.int32) if "dominant" in outputs else None,
            weight=np.empty(pixels, np.float32) if "dominant" in outputs else None,
        )

    def rows(self, whole: Window, part: Window) -> _Images:
        """Return the rows `part` of images that hold `whole`; no copies."""
        first, last = ((row - whole.top) * whole.width for row in (part.top, part.bottom))

        def cut(image: np.ndarray | None, channels: int = 1) -> np.ndarray | None:
            return None if image is None else image[first * channels : last * channels]

        images = map(cut, (self.depth, self.alpha, self.dominant, self.weight))
        return _Images(self.background, cut(self.color, 3), *images)

    @property
    def dominance_only(self) -> bool:
        return self.color is None and self.depth is None and self.alpha is None

    def rendering(self, window: Window) -> Rendering:
        shape = (window.height, window.width)
        return Rendering(
            color=None if self.color is None else self.color.reshape(*shape, 3),
            depth=None if self.depth is None else self.depth.reshape(shape),
            alpha=None if self.alpha is None else self.alpha.reshape(shape),
            dominant=None if self.dominant is None else self.dominant.reshape(shape),
            dominant_weight=None if self.weight is None else self.weight.reshape(shape),
        )


def _composite(
    step: Step,
    records: Records,
    quality: RenderQuality,
    images: _Images,
    states: np.ndarray,
    winners: np.ndarray,
    threads: int,
) -> None:
    limits = quality.limits()
    # Without a stop of its own the kernel is compiled without one.
    t_stop = np.float32(quality.transmittance_stop) if quality.transmittance_stop > 0 else None

    def work(first: int, last: int) -> None:
        shared = (*step.arguments(first, last, records), limits, states, winners, t_stop)
        if images.dominance_only:
            dominate(*shared, images.dominant, images.weight)
        else:
            composite(
                *shared, images.background, images.color, images.depth, images.alpha, images.dominant, images.weight
            )

    step.paint(work, threads)


class Clock:
    """Adds the time since the last lap to a phase; does nothing without statistics."""

    def __init__(self, statistics: FrameStatistics | None, threads: int) -> None:
        self._now = thread_time if threads == 1 else perf_counter
        self._statistics, self._start = statistics, self._now()

    def lap(self, phase: str) -> None:
        """Add the time since the last lap to `phase`."""
        if self._statistics is not None:
            now = self._now()
            spent = self._statistics.milliseconds
            spent[phase] = spent.get(phase, 0.0) + 1e3 * (now - self._start)
            self._start = now

    def count(self, **counts: int) -> None:
        """Add to the counts of these names."""
        if self._statistics is not None:
            for name, number in counts.items():
                self._statistics.counts[name] = self._statistics.counts.get(name, 0) + number
