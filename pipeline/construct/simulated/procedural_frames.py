"""RGB-D frames of a procedural scene, on demand: what a depth camera on the walk would have recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float32, UInt8

from pipeline.render import color_image, prepare, render
from pipeline.scene.scene import Scene
from pipeline.scene.views import View

SEEN_ALPHA = 0.5
"""A pixel whose opacity is lower has no depth, as where a depth camera gets no echo."""


def rgbd_frames(
    scene: Scene, views: Iterable[View] | None = None, *, threads: int = 1
) -> Iterator[tuple[UInt8[np.ndarray, "H W 3"], Float32[np.ndarray, "H W"]]]:
    """Yield the colour and depth of each view, rendered when it is asked for.

    Args:
        scene: The scene.
        views: Views to render, in order; None for all recorded ones.
        threads: Threads inside a frame.

    Yields:
        8-bit sRGB, and z-depth in metres with 0 where nothing is seen.
    """
    prepared = prepare(scene.gaussians)
    for view in scene.views if views is None else views:
        rendering = render(prepared, view.camera, ("color", "depth", "alpha"), threads=threads)
        assert rendering.depth is not None, "it was asked for"
        assert rendering.alpha is not None, "it was asked for"
        yield color_image(rendering), np.where(rendering.alpha >= SEEN_ALPHA, rendering.depth, np.float32(0.0))
