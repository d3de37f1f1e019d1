"""Colours of points from photographs that see them: nothing is taken through a surface in front."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float32

from pipeline.construct.fusion.fuse_surface import SAME_SURFACE, Points, lens
from pipeline.geometry import Camera
from pipeline.render.threads import run_each, split
from pipeline.scene.captures import Frame

DRAWN_SPACINGS = 0.6
"""Half the side of a drawn point, in spacings: neighbours overlap, so that what is behind shows nowhere."""


def nearest_surface(points: Points, camera: Camera) -> Float32[np.ndarray, "H W"]:
    """Return the z-depth of the nearest point at each pixel, each drawn as a square; infinite where there is none."""
    from pipeline.construct.fusion.fuse_kernels import draw_depth

    nearest = np.full((camera.height, camera.width), np.inf, np.float32)
    radii = np.float32(2 * DRAWN_SPACINGS) * points.radii
    draw_depth(points.positions, radii, lens(camera), camera.world_to_camera, nearest)
    return nearest


def point_colors(
    points: Points, frames: Sequence[Frame], *, threads: int = 1, progress: Callable[[], object] | None = None
) -> Float32[np.ndarray, "P 3"]:
    """Return the mean colour of each point, 0 to 1, over the photographs that show it; NaN where none does.

    A photograph counts with the cosine between its ray and the normal over the squared depth: the pixels a patch of
    the surface has in it. A point is shown where nothing lies in front of any of the four pixels around it, in the
    photograph's own camera, which need not be the depth's.

    Args:
        points: P points.
        frames: Frames with a photograph; one image is held at a time.
        threads: Threads.
        progress: Called after each frame.
    """
    from pipeline.construct.fusion.fuse_kernels import add_colors

    count = len(points)
    sums = np.zeros((count, 4), np.float32)
    parts = split(count, 4 * threads)
    for frame in frames:
        camera = frame.camera
        image = frame.read_image()
        arguments = (image, nearest_surface(points, camera), lens(camera), camera.world_to_camera, SAME_SURFACE, sums)

        def work(k: int, arguments: tuple[object, ...] = arguments) -> None:
            add_colors(points.positions, points.normals, *parts[k], *arguments)

        run_each(work, len(parts), threads)
        if progress is not None:
            progress()
    weight = sums[:, :1]
    return np.divide(sums[:, 1:], weight, out=np.full((count, 3), np.nan, np.float32), where=weight > 0)
