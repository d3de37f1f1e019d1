"""Colours fitted to the photographs through the renderer: neighbours that overlap share what a mean gave to each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, UInt8

from pipeline.construct.mesh.mesh_surfels import SH_C0
from pipeline.geometry import Camera
from pipeline.render import prepare, render, top_contributors
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame

WIDTH_PX = 320
"""Photographs are compared at no more than this width: a quarter of the time for a hundredth of a dB."""
HEAVIEST = 4
"""Gaussians of a pixel that take up its error: opaque surfaces have few that count."""
DAMPING = 1.0
"""Pixels' worth of weight that hold a colour where it was: one that hardly shows is not moved by noise."""


def refit_colors(
    gaussians: Gaussians,
    frames: Sequence[Frame],
    rounds: int,
    *,
    threads: int = 1,
    progress: Callable[[], object] | None = None,
) -> Gaussians:
    """Return the Gaussians with colours nearer to the photographs; nothing else changes.

    In each round every Gaussian takes up the mean error of the pixels it shows in, weighed by T * alpha: a Jacobi
    step of the least-squares problem that colours are once geometry is fixed.

    Args:
        gaussians: Gaussians of degree 0.
        frames: Frames with a photograph; one image is held at a time.
        rounds: Times all photographs are gone through.
        threads: Threads inside a frame; no number of them changes a result.
        progress: Called after each frame.
    """
    count, colors = len(gaussians), gaussians.sh.astype(np.float64)
    for _ in range(rounds):
        prepared = prepare(gaussians)
        errors, weight = np.zeros((3, count)), np.full(count, DAMPING)
        for frame in frames:
            camera, image = _smaller(frame.camera, frame.read_image())
            seen = render(prepared, camera, ("color",), threads=threads).color
            assert seen is not None, "it was asked for"
            shown = top_contributors(prepared, camera, HEAVIEST, threads=threads)
            some = shown.ids >= 0
            ids, weights = shown.ids[some], shown.weights[some].astype(np.float64)
            weight += np.bincount(ids, weights, count)
            for channel in range(3):
                error = np.broadcast_to((image - seen)[..., channel, None], some.shape)[some]
                errors[channel] += np.bincount(ids, weights * error, count)
            if progress is not None:
                progress()
        colors[:, 0] += (errors / weight).T / SH_C0
        gaussians = replace(gaussians, sh=colors.astype(np.float32))
    return gaussians


def _smaller(camera: Camera, image: UInt8[np.ndarray, "H W 3"]) -> tuple[Camera, Float64[np.ndarray, "h w 3"]]:
    """Return both at `WIDTH_PX` at most, colours 0 to 1."""
    from PIL import Image

    width = min(WIDTH_PX, camera.width)
    height = max(1, round(camera.height * width / camera.width))
    if width < camera.width:
        image = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX))
    return camera.resized(width, height), image / 255.0
