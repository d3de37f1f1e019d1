"""Which frames of a capture to build from: those that show the most of the scene, and sharp ones.

Neighbouring frames of a video show the same and many are blurred by motion. Sharpness is the variance of the
Laplacian, compared with the frame's neighbours, since a plain wall is smooth however still the hand. Coverage counts
voxels of the surface seen through depth; without depth, voxels of the view frusta stand in for it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int64, UInt8

from pipeline.geometry import Camera
from pipeline.scene.captures.capture import Capture, Frame, Skipped, blank_depth

SHARPNESS_WIDTH = 320
"""Pixels: noise of the sensor has gone at this width, motion blur has not."""
CANDIDATES = 4
"""Frames looked at for each one chosen; of a video of thousands the rest would be near copies of these."""
NEIGHBOURS = 4
"""Candidates before and after a frame that its sharpness is compared with."""
DECAY = 0.5
"""What a voxel is worth once more when it has been seen: a second look helps, a tenth hardly."""
SAMPLES = 1200
"""Depth pixels looked at, about; the grid is regular."""
FRUSTUM_STEPS = (0.25, 0.5, 0.75, 1.0)
"""Depths, as parts of the capture's reach, at which frusta without depth are sampled."""
_VOXELS_PER_REACH = 8
"""Voxels along the reach of a capture without depth (its unit may not be metres): about the samples' spacing."""


@dataclass(frozen=True, slots=True)
class _Look:
    index: int
    sharpness: float
    voxels: Int64[np.ndarray, "v"]


def select_frames(
    capture: Capture, count: int, *, voxel_m: float = 0.1, progress: Callable[[int], object] | None = None
) -> Capture:
    """Return the capture with up to `count` frames that together show the most, sharp ones preferred.

    Up to `CANDIDATES` frames for each one wanted, spread evenly, are read once. Frames are then taken one by one: each
    time the one with the largest gain, the sum over its voxels of `DECAY` to the number of times they were seen
    already, times its sharpness relative to its neighbours' median, at most 1. Ties go to the earlier frame. The same
    capture gives the same frames. Candidates with blank depth are left out and counted.

    Args:
        capture: Where to choose from.
        count: Most frames, at least 1.
        voxel_m: Edge of a voxel of the surface, metres.
        progress: Called with the number of candidates read.

    Returns:
        The chosen frames in capture order; all usable ones where there are no more than `count`.

    Raises:
        ValueError: `count` is below 1.
        InputError: An image cannot be read, or no candidate is usable.
    """
    if count < 1:
        raise ValueError(f"select_frames needs a count of at least 1, got {count}")
    total = len(capture)
    picks = np.unique(np.linspace(0, total - 1, min(total, CANDIDATES * count)).round().astype(int)).tolist()
    reach = _reach(capture.cameras)
    looks: list[_Look] = []
    blanks: list[Skipped] = []
    for done, index in enumerate(picks, start=1):
        look = _look(capture.frames[index], index, voxel_m, reach)
        if isinstance(look, Skipped):
            blanks.append(look)
        else:
            looks.append(look)
        if progress is not None:
            progress(done)
    chosen = sorted(_greedy(looks, count))
    frames = tuple(capture.frames[i] for i in chosen)
    return replace(capture, frames=frames, skipped=(*capture.skipped, *blanks))


def laplacian_variance(image: UInt8[np.ndarray, "H W 3"]) -> float:
    """Return the variance of the Laplacian of the grey image at a width of `SHARPNESS_WIDTH`: low means blurred."""
    from PIL import Image

    height, width = image.shape[:2]
    grey = Image.fromarray(image).convert("L")
    if width > SHARPNESS_WIDTH:
        grey = grey.resize((SHARPNESS_WIDTH, max(3, round(height * SHARPNESS_WIDTH / width))), Image.Resampling.BOX)
    g = np.asarray(grey, np.float64)
    if min(g.shape) < 3:
        return 0.0
    laplacian = g[:-2, 1:-1] + g[2:, 1:-1] + g[1:-1, :-2] + g[1:-1, 2:] - 4 * g[1:-1, 1:-1]
    return float(laplacian.var())


def seen_voxels(frame: Frame, voxel_m: float, reach: float) -> Int64[np.ndarray, "v"] | Skipped:
    """Return the voxels a frame sees, as sorted keys, or why it is to be skipped.

    Args:
        frame: The frame.
        voxel_m: Edge of a voxel, metres, where there is depth.
        reach: How far a capture without depth looks, in its own unit; its voxels follow from it.
    """
    if frame.depth is None:
        camera, edge = frame.camera.resized(16, 12), reach / _VOXELS_PER_REACH
        depths = np.repeat(np.array(FRUSTUM_STEPS)[:, None, None] * reach, 12, axis=1).repeat(16, axis=2)
        local = np.concatenate([camera.unproject(depth).reshape(-1, 3) for depth in depths])
        return _keys(camera, local, edge)
    depth_m, camera = frame.read_depth(), frame.depth_lens
    blank = blank_depth(frame, depth_m)
    if blank is not None:
        return blank
    step = max(1, int(np.sqrt(depth_m.size / SAMPLES)))
    rows, columns = (np.arange(step // 2, size, step) for size in depth_m.shape)
    z = depth_m[np.ix_(rows, columns)].astype(np.float64)
    x = (columns[None, :] + 0.5 - camera.K[0, 2]) / camera.K[0, 0] * z
    y = (rows[:, None] + 0.5 - camera.K[1, 2]) / camera.K[1, 1] * z
    return _keys(camera, np.stack([x, y, z], axis=-1)[z > 0], voxel_m)


def _keys(camera: Camera, local: Float[np.ndarray, "n 3"], edge: float) -> Int64[np.ndarray, "v"]:
    pose = camera.camera_to_world
    cells = np.floor((local @ pose[:, :3].T + pose[:, 3]) / edge).astype(np.int64)
    # 21 bits an axis: a million voxels each way from the origin.
    return np.unique(((cells[:, 0] & 0x1FFFFF) << 42) | ((cells[:, 1] & 0x1FFFFF) << 21) | (cells[:, 2] & 0x1FFFFF))


def _look(frame: Frame, index: int, voxel_m: float, reach: float) -> _Look | Skipped:
    voxels = seen_voxels(frame, voxel_m, reach)
    if isinstance(voxels, Skipped):
        return voxels
    return _Look(index, 1.0 if frame.image is None else laplacian_variance(frame.read_image()), voxels)


def _reach(cameras: tuple[Camera, ...]) -> float:
    """Return how far frusta without depth reach: as far as the cameras are spread, or 1 where they are at one place."""
    centers = np.array([camera.center for camera in cameras])
    return float(np.linalg.norm(np.ptp(centers, axis=0))) or 1.0


def _greedy(looks: list[_Look], count: int) -> list[int]:
    """Return the indices of the frames taken; gains only fall, so one that leads once brought up to date is best."""
    if len(looks) <= count:
        return [look.index for look in looks]
    keys, inverse = np.unique(np.concatenate([look.voxels for look in looks]), return_inverse=True)
    rows = np.split(inverse, np.cumsum([len(look.voxels) for look in looks])[:-1])
    worth, sharp = np.ones(len(keys)), _relative_sharpness(looks)
    heap = [(-float(sharp[i] * len(row)), i) for i, row in enumerate(rows)]
    heapq.heapify(heap)
    chosen: list[int] = []
    while heap and len(chosen) < count:
        _, i = heapq.heappop(heap)
        gain = -float(sharp[i] * worth[rows[i]].sum())
        if heap and (gain, i) > heap[0]:
            heapq.heappush(heap, (gain, i))
            continue
        worth[rows[i]] *= DECAY
        chosen.append(looks[i].index)
    return chosen


def _relative_sharpness(looks: list[_Look]) -> Float[np.ndarray, "n"]:
    sharpness = np.array([look.sharpness for look in looks])
    n = len(sharpness)
    around = [np.median(sharpness[max(0, i - NEIGHBOURS) : min(n, i + NEIGHBOURS + 1)]) for i in range(n)]
    return np.minimum(1.0, sharpness / np.maximum(around, 1e-12))
