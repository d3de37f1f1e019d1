"""Boxes of a detector to pixels: a box also holds what is behind and beside the thing, which depth tells apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Shaped

from pipeline.construct.semantics.labels_2d.source import FrameLabels
from pipeline.construct.semantics.labels_2d.surroundings import surroundings
from pipeline.scene.captures import Frame
from pipeline.scene.semantics import UNLABELLED

CORE = 0.5
"""Middle part of a box, along each side, where the thing shows."""
NEARER = 35
"""Percentile of the core's depth taken for the thing's: through things with gaps one sees what is behind."""
STEP = 0.03
"""Jump of depth between neighbouring pixels, as a share of depth, over which a surface is not the same one..."""
LEAST_STEP_M = 0.03
"""... and the least such jump: depth cameras jitter by a centimetre or two."""
DEEP = 0.75
"""A thing reaches so far before and behind its middle, as a share of the longer side of its box, in metres there."""

LEFT = 0.4
"""Share of the thing's core that has to be left without the planes around it."""


@dataclass(frozen=True, slots=True)
class Detection:
    """A thing a detector found."""

    category: int
    """Index into the detector's vocabulary."""
    confidence: float
    """0 to 1."""
    box: tuple[float, float, float, float]
    """Left, top, right, bottom in pixels; may reach over the image's edge."""
    mask: Bool[np.ndarray, "H W"] | None = None
    """Its pixels where the detector has them; None takes the box."""


def labels_of(frame: Frame, detections: list[Detection], *, depth: bool) -> FrameLabels:
    """Return the painted detections of a frame, cut out by depth where asked for and at hand."""
    at_hand = frame.depth is not None and frame.depth_camera is None
    wanted = depth and any(one.mask is None for one in detections)  # a rendered depth image costs as much as detecting
    depth_m = frame.read_depth() if wanted and at_hand else None
    focal = float(frame.camera.K[0, 0])
    return paint(detections, (frame.camera.height, frame.camera.width), depth_m, focal)


def paint(
    detections: Sequence[Detection],
    size: tuple[int, int],
    depth_m: Float32[np.ndarray, "H W"] | None = None,
    focal_px: float = 1.0,
) -> FrameLabels:
    """Return the label image of a frame's detections: the surer one where two overlap.

    Args:
        detections: What was found.
        size: Height and width of the image.
        depth_m: z-depth of the same camera, 0 where there is none; None leaves boxes whole.
        focal_px: Focal length, which says how many metres a box spans.
    """
    category, confidence = np.full(size, UNLABELLED, np.int32), np.zeros(size, np.float32)
    for one in sorted(detections, key=lambda d: d.confidence):
        rows, columns = _span(one.box, size)
        if rows.start >= rows.stop or columns.start >= columns.stop:
            continue
        if one.mask is not None:
            mask = one.mask[rows, columns]
        elif depth_m is None:
            mask = np.ones((rows.stop - rows.start, columns.stop - columns.start), bool)
        else:
            mask = thing_in_box(depth_m, rows, columns, focal_px)
        category[rows, columns][mask] = one.category
        confidence[rows, columns][mask] = one.confidence
    return FrameLabels(category, confidence)


def thing_in_box(
    depth_m: Float32[np.ndarray, "H W"], rows: slice, columns: slice, focal_px: float
) -> Bool[np.ndarray, "h w"]:
    """Return which pixels of a box belong to the thing in its middle, by depth.

    The thing is the surface without jumps of depth that holds most of the box's core, as far as things of that size
    are deep. Planes that run on beyond the box, floor and walls, are left out, unless that takes most of the thing: a
    table larger than its box is no floor. Boxes without depth in their core come back whole.

    Args:
        depth_m: z-depth of the whole image, 0 where there is none.
        rows: The box's rows, inside the image.
        columns: The box's columns.
        focal_px: Focal length of the camera.
    """
    from scipy.ndimage import label

    around = surroundings(depth_m, rows, columns)
    depth_m = depth_m[rows, columns]
    height, width = depth_m.shape
    top, left = int(height * (1 - CORE) / 2), int(width * (1 - CORE) / 2)
    core = np.zeros(depth_m.shape, bool)
    core[top : height - top, left : width - left] = True
    seen = depth_m > 0
    if not (core & seen).any():
        return np.ones(depth_m.shape, bool)
    middle = float(np.percentile(depth_m[core & seen], NEARER, method="lower"))
    reach = DEEP * max(height, width) * middle / focal_px
    near = seen & (np.abs(depth_m - middle) <= reach)
    if (core & near & ~around).sum() >= LEFT * (core & near).sum():
        near &= ~around
    parts, count = label(near & ~_edges(depth_m))
    if not count:
        return near
    sizes = np.bincount(parts[core & near], minlength=count + 1)
    sizes[0] = 0
    if not sizes.any():
        return near
    # Legs and arms come apart in the image: every part that shows in the core with a tenth of the largest counts.
    kept = sizes >= max(1, 0.1 * sizes.max())
    return _grown(kept[parts] & (parts > 0), near)


def _edges(depth_m: Float32[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Return the pixels on the far side of a jump of depth."""
    edges = np.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        before, after = (
            np.take(depth_m, range(*cut), axis) for cut in ((0, depth_m.shape[axis] - 1), (1, depth_m.shape[axis]))
        )
        limit = np.maximum(LEAST_STEP_M, STEP * np.minimum(before, after))
        first, second = _pair(edges, axis)
        first |= before - after > limit
        second |= after - before > limit
    return edges


def _pair(image: Shaped[np.ndarray, "h w"], axis: int) -> tuple[Shaped[np.ndarray, "_ _"], Shaped[np.ndarray, "_ _"]]:
    """Return views of all pixels but the last, and all but the first, along an axis."""
    return (image[:-1], image[1:]) if axis == 0 else (image[:, :-1], image[:, 1:])


def _grown(mask: Bool[np.ndarray, "h w"], within: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Return the mask and its four-neighbours within another: the edge pixels that were cut away."""
    wide = mask.copy()
    for axis in (0, 1):
        (first, second), (source_first, source_second) = _pair(wide, axis), _pair(mask, axis)
        first |= source_second
        second |= source_first
    return wide & within


def _span(box: tuple[float, float, float, float], size: tuple[int, int]) -> tuple[slice, slice]:
    left, top, right, bottom = box
    height, width = size
    return (
        slice(max(0, round(top)), min(height, max(0, round(bottom)))),
        slice(max(0, round(left)), min(width, max(0, round(right)))),
    )
