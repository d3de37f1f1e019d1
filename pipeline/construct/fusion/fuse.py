"""From posed depth to Gaussians on the surfaces, with the photographs' colours: a scene in seconds, before training."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from pipeline.construct.fusion.fuse_colors import point_colors
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.fusion.fuse_fill import filled_points
from pipeline.construct.fusion.fuse_refit import refit_colors
from pipeline.construct.fusion.fuse_surface import ROUNDS, Points, agreement, surface_points
from pipeline.construct.mesh.mesh_surfels import SH_C0
from pipeline.geometry import rotations_to_quats
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame, Skipped
from pipeline.scene.captures.capture import blank_depth
from schemas.errors import InputError

SPREAD = 0.8
"""Standard deviation along the surface, in units of the neighbours' root mean square offset per axis: 0.7 spacings on
an even grid. Less leaves gaps, more blurs."""
NEIGHBOURS = 8
"""Nearest points whose offsets give a Gaussian its widths: the ring around it."""
NARROWEST, WIDEST = 0.7, 2.5
"""Bounds on the standard deviation, in spacings the voxels and pixels allow: a point in a cluster still closes its
voxel, one on a surface that is seen at a flat angle is long, one alone is no veil."""
THICKNESS = 0.1
"""Standard deviation along the normal, in those spacings: surfaces do not glow around edges."""
OPACITY = 0.95
"""A surface hides what is behind it, and training can still change it: at 0.99 the sigmoid has no slope left."""
GUESS_DENIED = 2
"""Depth images that may look through a guessed point: a stray pixel must not open what it closed. At 0 the kitchen
loses 0.25 dB, at 6 it gains nothing more."""
_CHUNK = 1 << 16
"""Points whose neighbours are held at once."""


@dataclass(frozen=True, slots=True)
class FusionReport:
    """What fusion read, dropped and made."""

    depth_frames: int
    """Frames whose depth was used."""
    color_frames: int
    """Frames whose photograph was used."""
    skipped: tuple[Skipped, ...]
    """Frames whose depth was blank; their photographs were used."""
    measured: int
    """Gaussians on measured surfaces."""
    guessed: int
    """Gaussians that close holes."""
    uncolored: int
    """Points left out because no photograph shows them."""
    seconds: float
    """Wall time."""


@dataclass(frozen=True, slots=True)
class Fused:
    """A scene's start."""

    gaussians: Gaussians
    """M flat Gaussians; spherical harmonics of degree 0."""
    report: FusionReport
    """How it was made."""


def fuse(
    frames: Sequence[Frame], config: FusionConfig | None = None, *, progress: Callable[[float], object] | None = None
) -> Fused:
    """Return flat Gaussians on the surfaces that the frames' depth agrees on, coloured by their photographs.

    The same frames give the same bits, whatever the thread count. One image is held at a time: memory grows with the
    surface, about 150 bytes for each voxel that ever had a point, not with the number of frames.

    Args:
        frames: Posed frames. One without depth, or with blank depth, lends its photograph, one without a photograph
            its depth.
        config: Voxel size and what is believed; defaults where None.
        progress: Called with the share of the work that is done, 0 to 1.

    Raises:
        InputError: No frame has depth, none has a photograph, nothing is left of the surfaces, or an image cannot be
            read.
    """
    config = config or FusionConfig()
    began = time.perf_counter()
    photographs = [frame for frame in frames if frame.image is not None]
    with_depth = [frame for frame in frames if frame.depth is not None]
    for what, some in (("photograph", photographs), ("depth image", with_depth)):
        if not some:
            raise InputError("fusion", field="frames", expected=f"at least one {what}", found=f"none in {len(frames)}")
    skipped: dict[str, Skipped] = {}
    depth_passes, photograph_passes = 1 + ROUNDS + config.fill, 1 + config.fill + config.color_rounds
    steps = _Steps(depth_passes * len(with_depth) + photograph_passes * len(photographs), progress)

    def depths() -> Iterator[tuple[Frame, Float32[np.ndarray, "h w"]]]:
        for frame in with_depth:
            if frame.name not in skipped:
                depth_m = frame.read_depth()
                blank = blank_depth(frame, depth_m)
                if blank is None:
                    yield frame, depth_m
                else:
                    skipped[frame.name] = blank
            steps.advance()

    least = min(config.least_frames, len(with_depth))
    points = surface_points(depths, config.voxel_m, config.farthest_m, least, threads=config.threads)
    if not len(points):
        found = f"none; {len(skipped)} of {len(with_depth)} depth images are blank"
        raise InputError("fusion", field="surface", expected=f"points that {least} depth images agree on", found=found)
    measured = len(points)
    if config.fill:
        guessed = filled_points(points, photographs, progress=steps.advance)
        clear = agreement(guessed, depths(), threads=config.threads).through <= GUESS_DENIED
        points = points.joined(guessed.take(clear))
    colors = point_colors(points, photographs, threads=config.threads, progress=steps.advance)
    colored = np.isfinite(colors).all(axis=1)
    if not colored.any():
        raise InputError("fusion", field="photographs", expected="some that show the surfaces", found="none")
    gaussians = refit_colors(
        flat_gaussians(points.take(colored), colors[colored]),
        photographs,
        config.color_rounds,
        threads=config.threads,
        progress=steps.advance,
    )
    report = FusionReport(
        depth_frames=len(with_depth) - len(skipped),
        color_frames=len(photographs),
        skipped=tuple(skipped.values()),
        measured=int(colored[:measured].sum()),
        guessed=int(colored[measured:].sum()),
        uncolored=int((~colored).sum()),
        seconds=time.perf_counter() - began,
    )
    return Fused(gaussians, report)


def flat_gaussians(points: Points, colors: Float32[np.ndarray, "P 3"]) -> Gaussians:
    """Return a Gaussian for each point, flat along its normal and as wide along the surface as its neighbours are off.

    Args:
        points: P points.
        colors: 0 to 1.
    """
    from scipy.spatial import cKDTree

    normals = points.normals.astype(np.float64)
    helper = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(helper, normals)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    second = np.cross(normals, first)
    tree, count = cKDTree(points.positions), min(NEIGHBOURS, len(points) - 1)
    moments = np.zeros((len(points), 2, 2))
    for start in range(0, len(points), _CHUNK) if count else ():
        part = slice(start, start + _CHUNK)
        _, found = tree.query(points.positions[part], k=count + 1)
        offsets = points.positions[np.asarray(found)[:, 1:]].astype(np.float64) - points.positions[part, None]
        along = np.stack([(offsets * axis[part, None]).sum(axis=2) for axis in (first, second)], axis=2)
        moments[part] = np.swapaxes(along, 1, 2) @ along / count
    squares, turned = np.linalg.eigh(moments)
    spacing = 2.0 * points.radii[:, None].astype(np.float64)
    widths = np.clip(SPREAD * np.sqrt(np.maximum(squares, 0.0)), NARROWEST * spacing, WIDEST * spacing)
    axes = turned[:, 0, :, None] * first[:, None] + turned[:, 1, :, None] * second[:, None]
    rotations = np.stack([axes[:, 0], axes[:, 1], np.cross(axes[:, 0], axes[:, 1])], axis=-1)
    return Gaussians(
        means=points.positions,
        quats=rotations_to_quats(rotations).astype(np.float32),
        log_scales=np.log(np.concatenate([widths, THICKNESS * spacing], axis=1)).astype(np.float32),
        opacity_logits=np.full(len(points), np.log(OPACITY / (1 - OPACITY)), np.float32),
        sh=((colors - 0.5) / SH_C0).astype(np.float32)[:, None, :],
    )


class _Steps:
    """Counts steps of work and tells the share that is done."""

    def __init__(self, total: int, progress: Callable[[float], object] | None) -> None:
        self._total, self._done, self._progress = total, 0, progress

    def advance(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done / self._total)
