"""How much blending a frame needs, for figures that do not depend on the scene: nanoseconds per vector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Camera
from pipeline.render.prepare import PreparedGaussians
from pipeline.render.quality import EXACT, RenderQuality
from pipeline.render.window import Window


@dataclass(frozen=True, slots=True)
class BlendCounts:
    """Blending steps of one frame; a vector is one Gaussian in one block of 4 x 2 pixels."""

    vectors: int
    """Vectors evaluated."""
    contributing: int
    """Those in which at least one pixel took the Gaussian."""
    pixels: int
    """Pairs of a Gaussian and a pixel that took it."""


def count_blends(
    prepared: PreparedGaussians,
    camera: Camera,
    *,
    dominance: bool = False,
    near: float = 0.2,
    antialias: bool = False,
    quality: RenderQuality = EXACT,
) -> BlendCounts:
    """Return what `render` blends in one view; a pass of its own, so that frames pay nothing for it.

    Args:
        prepared: The scene.
        camera: The view, at the size that is really rendered.
        dominance: Stop as the dominance-only path does.
        near: Near plane, metres.
        antialias: As in `render`.
        quality: As in `render`, but for the scale.
    """
    from pipeline.render import count_kernels
    from pipeline.render.passes import Clock, sorted_records, steps
    from pipeline.render.tile_kernels import BLOCKS
    from pipeline.render.workspace import WORKSPACE

    clock, limits, totals = Clock(None, 1), quality.limits(), np.zeros(3, np.int64)
    stop = np.float32(quality.transmittance_stop)
    whole = Window.of(camera)
    records = sorted_records(
        prepared, camera, whole, near=near, antialias=antialias, quality=quality, threads=1, clock=clock
    )
    for step in steps(records, whole, 1, clock):
        tiles = len(step.band.live)
        states = WORKSPACE.array("states", tiles * BLOCKS * count_kernels.STATE, np.float32)
        count_kernels.count_blends(*step.arguments(0, tiles, records), limits, states, stop, dominance, totals)
    return BlendCounts(*map(int, totals))
