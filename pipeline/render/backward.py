"""Images of Gaussians under training, and the gradients of a loss on them: forward and back, on NumPy arrays.

`draw` takes raw parameters as they are at this step, with nothing prepared; `Drawing.gradients` returns those of the
Gaussians the image shows. PyTorch's side is pipeline/construct/training/rasterizer.py.

What is taken as constant: the depth order, which contributions pass 1/255, where a pixel stops, which Gaussians lie in
front of the near plane. Where alpha is capped at 0.99 the image does not change with what is capped, and the gradient
is 0 there (so it is in gsplat; the reference rasteriser lets it through). All else is differentiated: the direction
spherical harmonics are seen from, the projection's Jacobian and its clamp, the low-pass, and the activations of opacity
and scales.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, Int64, UInt8

from pipeline.geometry import Camera
from pipeline.render.activate_backward_kernels import activate, bound_blocks
from pipeline.render.binning import Records
from pipeline.render.blend_backward_kernels import CELL_SHIFT, STATE, SUMS, blend, lay_out, mark, unblend
from pipeline.render.culling import visible_blocks
from pipeline.render.lens import Lens
from pipeline.render.passes import PIECES_PER_THREAD, Clock, FrameStatistics, Step, sorted_records, steps
from pipeline.render.prepare import BLOCK, GROUP, ROWS, PreparedGaussians
from pipeline.render.project_backward_kernels import pull_back
from pipeline.render.project_kernels import MU, MV, NV, RECORD, SCALE
from pipeline.render.quality import EXACT
from pipeline.render.sh_kernels import shade
from pipeline.render.threads import run_each, split
from pipeline.render.tile_kernels import BLOCKS
from pipeline.render.window import Window
from pipeline.render.workspace import WORKSPACE

_KEPT = ("records", "ids", "rectangles", "geometry")
"""Arrays of the workspace that a drawing keeps until its gradients are known."""
_PARALLEL_RANGE = 1 << 12
"""Gaussians below which a range is not worth a thread."""


@dataclass(frozen=True, slots=True)
class RawGaussians:
    """M Gaussians as they are optimised; float32, C-contiguous, not checked for finite values."""

    means: Float32[np.ndarray, "M 3"]
    """Metres."""
    quats: Float32[np.ndarray, "M 4"]
    """wxyz, any norm; a zero quaternion makes its Gaussian invisible."""
    log_scales: Float32[np.ndarray, "M 3"]
    """Natural logarithm of the standard deviations, metres."""
    opacity_logits: Float32[np.ndarray, "M"]
    """Before the sigmoid."""
    sh: Float32[np.ndarray, "M K 3"]
    """Spherical harmonics, K = 1, 4, 9 or 16."""


@dataclass(frozen=True, slots=True)
class RawGradients:
    """Gradients of a loss with respect to the raw parameters of the n Gaussians of a drawing's `ids`."""

    means: Float32[np.ndarray, "n 3"]
    """Per metre."""
    quats: Float32[np.ndarray, "n 4"]
    """With respect to the unnormalised quaternion: at a right angle to it."""
    log_scales: Float32[np.ndarray, "n 3"]
    """Per unit of the natural logarithm."""
    opacity_logits: Float32[np.ndarray, "n"]
    """Before the sigmoid."""
    sh: Float32[np.ndarray, "n U 3"]
    """The U coefficients of the degree in use; those beyond have none."""
    screen_norm: Float32[np.ndarray, "n"]
    """Length of d loss / d (projected mean), with image axes from -1 to 1, as 3DGS's densification reads it."""


@dataclass(slots=True)
class Drawing:
    """Images of one view, and what the way back needs."""

    color: Float32[np.ndarray, "H W 3"]
    """Linear sum of w c plus the background behind it."""
    alpha: Float32[np.ndarray, "H W"]
    """Sum of the weights."""
    depth: Float32[np.ndarray, "H W"] | None
    """Sum of w z, metres."""
    inverse_depth: Float32[np.ndarray, "H W"] | None
    """Sum of w / z, per metre."""
    ids: Int32[np.ndarray, "n"]
    """Gaussians that touch a tile which was not yet opaque in front of them, rising."""
    milliseconds: dict[str, float]
    """By phase; filled where the caller asked for it."""
    _raw: RawGaussians
    _camera: Camera
    _rows: Int64[np.ndarray, "n"]
    _records: Records
    _geometry: Float32[np.ndarray, "floats"]
    _entries: Int32[np.ndarray, "entries"]
    _lists: Int64[np.ndarray, "slabs offsets"]
    _through: Float32[np.ndarray, "places"]
    _stops_at: Float32[np.ndarray, "places"]
    _background: Float32[np.ndarray, "3"]
    _degree: int
    _near: float
    _threads: int
    _lent: dict[str, UInt8[np.ndarray, "bytes"]] = field(default_factory=dict)

    @property
    def radius_px(self) -> Float32[np.ndarray, "n"]:
        """Three standard deviations along each Gaussian's longer axis on the image, low-pass included, pixels."""
        table = self._records.table.reshape(-1, RECORD)
        mu, mv, nv = (table[self._rows, f].astype(np.float64) / SCALE for f in (MU, MV, NV))
        # The covariance is the inverse of L^T L with L = [[mu, mv], [0, nv]].
        xx, xy, yy = 1 / mu**2 + (mv / (mu * nv)) ** 2, -mv / (mu * nv**2), 1 / nv**2
        middle, apart = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        return (3.0 * np.sqrt(middle + apart)).astype(np.float32)

    def gradients(
        self,
        color: Float[np.ndarray, "H W 3"],
        alpha: Float[np.ndarray, "H W"] | None = None,
        depth: Float[np.ndarray, "H W"] | None = None,
        inverse_depth: Float[np.ndarray, "H W"] | None = None,
        *,
        tiles: Bool[np.ndarray, "rows columns"] | None = None,
    ) -> RawGradients:
        """Return the parameters' gradients, given those of the images. The parameters must be as they were drawn.

        Args:
            color: Gradient of the loss with respect to the image of that name, float32; likewise the next three, where
                None stands for 0.
            alpha: See `color`.
            depth: See `color`; may be given only if the drawing has it. Likewise the next.
            inverse_depth: See `color`.
            tiles: Tiles of 16 x 16 pixels whose gradient counts; None for all. Tiles without any are skipped anyway.

        Raises:
            ValueError: The drawing was released.
        """
        if not self._lent:
            raise ValueError("this drawing was released: its memory may hold another one's numbers")
        clock = Clock(FrameStatistics(milliseconds=self.milliseconds), self._threads)
        window = Window.of(self._camera)
        wanted = np.ones(window.rows * window.columns, bool) if tiles is None else np.ascontiguousarray(tiles).ravel()
        count, coefficients = len(self._rows), self._raw.sh.shape[1]
        bases = np.empty(count + 1, np.int64)
        rows_of = WORKSPACE.array("rows of sums", 2 * len(self._records.ids), np.int64)
        lay_out(self._rows, self._records.rectangles, bases, rows_of)
        sums = WORKSPACE.array("sums", int(bases[-1]) * SUMS, np.float32)
        pieces = split(count, self._pieces(count))

        def clear(k: int) -> None:
            sums[bases[pieces[k][0]] * SUMS : bases[pieces[k][1]] * SUMS] = 0

        run_each(clear, len(pieces), self._threads)
        clock.lap("lay out")
        side = (1 << CELL_SHIFT) - 1
        cells = ((window.columns + side) >> CELL_SHIFT) * ((window.rows + side) >> CELL_SHIFT)
        alpha_gradient = np.zeros(self.alpha.size, np.float32) if alpha is None else _flat(alpha)
        images = (_flat(color), alpha_gradient, *(None if g is None else _flat(g) for g in (depth, inverse_depth)))
        ranges = split(cells, cells if self._threads > 1 else 1)

        def work(k: int) -> None:
            unblend(
                *ranges[k], window.edges, self._lists, self._entries, self._records.table, EXACT.limits(), wanted,
                self._through, self._stops_at, self._background, *images, rows_of, sums,
            )  # fmt: skip

        run_each(work, len(ranges), self._threads)
        clock.lap("unblend")
        shape = ((count, 3), (count, 4), (count, 3), (count,), (count, (self._degree + 1) ** 2, 3), (count,))
        found = RawGradients(*(np.empty(size, np.float32) for size in shape))
        flat = [getattr(found, name).reshape(-1) for name in RawGradients.__slots__]
        half_size = np.array([self._camera.width / 2, self._camera.height / 2], np.float32)
        packed = Lens.of(self._camera).packed(self._near)

        def pull(k: int) -> None:
            pull_back(
                *pieces[k], self._rows, bases, sums, self._records.table, self._records.ids, self._geometry,
                self._raw.quats.reshape(-1), self._raw.sh.reshape(-1), coefficients, self._degree, packed, half_size,
                *flat,
            )  # fmt: skip

        run_each(pull, len(pieces), self._threads)
        clock.lap("pull back")
        return found

    def release(self) -> None:
        """Give the memory back to this thread's workspace; the drawing's gradients cannot be asked for any more."""
        WORKSPACE.give_back(self._lent)
        self._lent = {}

    def _pieces(self, count: int) -> int:
        if self._threads == 1:
            return 1
        return max(1, min(self._threads * PIECES_PER_THREAD, count // _PARALLEL_RANGE))


def draw(
    raw: RawGaussians,
    camera: Camera,
    *,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near: float = 0.2,
    sh_degree: int,
    depth: bool = False,
    inverse_depth: bool = False,
    threads: int = 1,
    timed: bool = False,
) -> Drawing:
    """Return the images of one view, to float32 rounding those of `render`; the same bits at any thread count.

    All tiles are kept at once, so an image of H x W pixels takes 60 bytes a pixel beside the Gaussians.

    Args:
        raw: The parameters at this step. They must not change before the drawing's gradients are asked for.
        camera: Lens, pose and image size.
        background: Linear RGB seen where transmittance is left.
        near: Gaussians at z <= near are left out, metres.
        sh_degree: Highest spherical-harmonics degree used, at most what is stored.
        depth: Whether the sum of w z is wanted.
        inverse_depth: Whether the sum of w / z is wanted.
        threads: Threads inside this frame.
        timed: Whether to fill in `milliseconds`, in CPU time of this thread where there is one, else wall time.
    """
    statistics = FrameStatistics()
    clock = Clock(statistics if timed else None, threads)
    window, lens = Window.of(camera), Lens.of(camera)
    packed, limits = lens.packed(near), EXACT.limits()
    prepared = _activated(raw, lens, window, near, threads)
    clock.lap("activate")
    records = sorted_records(
        prepared, camera, window, near=near, antialias=False, quality=EXACT, threads=threads, clock=clock
    )
    pixels, tiles = window.width * window.height, window.columns * window.rows
    color, alpha = np.empty(pixels * 3, np.float32), np.empty(pixels, np.float32)
    z_sum = np.empty(pixels, np.float32) if depth else None
    inverse_sum = np.empty(pixels, np.float32) if inverse_depth else None
    through, stops_at = (np.empty(tiles * BLOCKS * 8, np.float32) for _ in range(2))
    states = WORKSPACE.array("drawing states", tiles * BLOCKS * STATE, np.float32)
    passed = np.zeros(tiles, np.int64)
    behind = np.array(background, np.float32)
    seen = np.zeros(len(records.ids), np.uint8)
    sh, coefficients = raw.sh.reshape(-1), raw.sh.shape[1]
    entries, lists, listed = [], [], 0
    for step in steps(records, window, threads, clock, band_tiles=tiles):
        touched = step.slab.touched

        def color_piece(k: int, touched: tuple[np.ndarray, ...] = touched) -> None:
            shade(sh, coefficients, sh_degree, packed, records.ids, touched[k], len(touched[k]), records.table)
            mark(touched[k], records.table, seen)

        run_each(color_piece, len(touched), threads)
        clock.lap("shade")
        entries.append(step.slab.entries.copy())
        lists.append(step.slab.offsets + listed)
        listed += len(step.slab.entries)

        def work(first: int, last: int, step: Step = step) -> None:
            blend(
                *step.arguments(first, last, records), limits, states, passed, behind,
                color, alpha, z_sum, inverse_sum, through, stops_at,
            )  # fmt: skip

        step.paint(work, threads)
        clock.lap("blend")
    rows = np.flatnonzero(seen)
    shape = (window.height, window.width)
    return Drawing(
        color=color.reshape(*shape, 3),
        alpha=alpha.reshape(shape),
        depth=None if z_sum is None else z_sum.reshape(shape),
        inverse_depth=None if inverse_sum is None else inverse_sum.reshape(shape),
        ids=records.ids[rows],
        milliseconds=statistics.milliseconds,
        _raw=raw,
        _camera=camera,
        _rows=rows,
        _records=records,
        _geometry=prepared.geometry.reshape(-1),
        _entries=np.concatenate(entries),
        _lists=np.array(lists),
        _through=through,
        _stops_at=stops_at,
        _background=behind,
        _degree=sh_degree,
        _near=near,
        _threads=threads,
        _lent=WORKSPACE.lend(*_KEPT),
    )


def _activated(raw: RawGaussians, lens: Lens, window: Window, near: float, threads: int) -> PreparedGaussians:
    """Return the Gaussians as projection reads them: only blocks the view may show are filled in, in stored order."""
    blocks = -(-len(raw.means) // BLOCK)
    bounds = np.empty((blocks, 3)), np.empty((blocks, 3)), np.empty(blocks)
    means, log_scales = raw.means.reshape(-1), raw.log_scales.reshape(-1)
    ids = np.full(blocks * BLOCK, -1, np.int32)
    ids[: len(raw.means)] = np.arange(len(raw.means), dtype=np.int32)
    pieces = split(blocks, threads)
    run_each(lambda k: bound_blocks(means, log_scales, *pieces[k], *bounds), len(pieces), threads)
    geometry = WORKSPACE.array("geometry", blocks * BLOCK * ROWS, np.float32)
    prepared = PreparedGaussians(geometry.reshape(-1, ROWS, GROUP), ids, *bounds, raw.sh)
    visible = visible_blocks(prepared, lens, window, near)
    pieces = split(len(visible), 1 if threads == 1 else threads * PIECES_PER_THREAD)
    run_each(
        lambda k: activate(means, raw.quats.reshape(-1), log_scales, raw.opacity_logits, visible, *pieces[k], geometry),
        len(pieces),
        threads,
    )
    return prepared


def _flat(image: Float[np.ndarray, "..."]) -> Float32[np.ndarray, "n"]:
    return np.ascontiguousarray(image, np.float32).reshape(-1)
