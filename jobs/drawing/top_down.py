"""A scene seen from above: its picture, cut off above eye level, and which pixels its clusters take."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int32, UInt8

from jobs.drawing.map_frame import LONG_SIDE, MapFrame
from jobs.drawing.overlays import MOST
from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, color_image, render

HEIGHT_M = 100.0
"""How far above the cut the camera hangs: walls of 2 m then lean by 2 % of their distance from the middle."""
ABOVE_EYES_M = 0.2
"""The cut lies so far above the median camera: ceilings and lamps go, furniture stays."""


def map_camera(frame: MapFrame, up: Float[np.ndarray, "3"], cut: float, long_side: int = LONG_SIDE) -> Camera:
    """Return a camera far above that sees the frame.

    Args:
        frame: What it sees.
        up: Unit vector opposite to gravity.
        cut: Height of the cut along `up`, metres; render with a near plane of `HEIGHT_M`.
        long_side: Pixels of the picture's longer side.
    """
    per_metre = frame.per_metre(long_side)
    width, height = frame.pixels(long_side)
    rotation = np.stack([frame.right, frame.down, -up])
    middle = frame.low + frame.size / 2
    centre = frame.right * middle[0] + frame.down * middle[1] + up * (cut + HEIGHT_M)
    focal = per_metre * (HEIGHT_M + 1.0)  # to scale a metre below the cut, amid what stands on the floor
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Camera(K, np.column_stack([rotation, -rotation @ centre]), width, height)


def map_picture(
    gaussians: PreparedGaussians,
    frame: MapFrame,
    up: Float[np.ndarray, "3"],
    stands: Float[np.ndarray, "k 3"],
    long_side: int = LONG_SIDE,
    threads: int = 1,
) -> UInt8[np.ndarray, "H W 4"]:
    """Return the scene below eye level from above, RGBA; clear where nothing is.

    Args:
        gaussians: The scene.
        frame: What is shown.
        up: Unit vector opposite to gravity.
        stands: Centres of the recorded cameras, at least one.
        long_side: Pixels of the picture's longer side.
        threads: Threads of the render.
    """
    cut = float(np.median(np.asarray(stands, np.float64) @ up)) + ABOVE_EYES_M
    camera = map_camera(frame, up, cut, long_side)
    seen = render(gaussians, camera, ("color", "alpha"), near=HEIGHT_M, threads=threads)
    assert seen.alpha is not None
    alpha = np.rint(np.clip(seen.alpha, 0.0, 1.0) * 255.0).astype(np.uint8)
    return np.dstack([color_image(seen), alpha])


def map_labels(
    frame: MapFrame,
    means: Float[np.ndarray, "M 3"],
    groups: Mapping[int, Int32[np.ndarray, "_"]],
    long_side: int = LONG_SIDE,
) -> UInt8[np.ndarray, "H W"]:
    """Return the group of each pixel of a map, counted from 1; larger groups lie below, so that small ones show.

    Args:
        frame: What is shown.
        means: Centres of all Gaussians, metres.
        groups: Gaussians by the number of their group.
        long_side: Pixels of the map's longer side.
    """
    width, height = frame.pixels(long_side)
    labels = np.zeros((height, width), np.uint8)
    radius = max(
        1, 2 * long_side // LONG_SIDE - 1
    )  # a pixel on a page; more where the gaps between Gaussians are wider
    reach = range(-radius, radius + 1)
    for number, ids in sorted(groups.items(), key=lambda item: -len(item[1])):
        places = (frame.at(means[ids]) * frame.per_metre(long_side)).astype(np.int64)
        for right in reach:
            for down in reach:
                x, y = places[:, 0] + right, places[:, 1] + down
                inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
                labels[y[inside], x[inside]] = number % MOST + 1
    return labels
