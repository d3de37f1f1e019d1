"""Points on the surfaces that several depth images agree on, one in each voxel.

Every depth image is smoothed by planes and summed into voxels. Noise leaves a surface several voxels thick, so each
point is then moved along its normal to the mean of what all images measure there, and what has become one is merged
again. Points that too few images confirm, or that others look through, go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int32, Int64

from pipeline.geometry import Camera
from pipeline.render.threads import run_each, split
from pipeline.scene.captures import Frame

SAME_SURFACE = 0.03
"""Share of depth by which two images of one surface differ at most: 6 cm at 2 m."""
PIXEL_NOISE = 0.015
"""Share of depth by which neighbouring pixels differ on a surface that faces the camera."""
TAP_ANGLE = 1 / 260
"""Radians between the pixels a plane is fitted to, where pixels are finer than that: 2 pixels of a Kinect."""
ROUNDS = 2
"""Times the points are moved and merged; a third changes nothing to speak of."""
LOOKED_THROUGH = 0.2
"""Images that look through a point, as a share of those that confirm it, beyond which it goes."""
_CAPACITY = 1 << 18


@dataclass(frozen=True, slots=True)
class Points:
    """Oriented points."""

    positions: Float32[np.ndarray, "P 3"]
    """World, metres."""
    normals: Float32[np.ndarray, "P 3"]
    """World, unit, towards the cameras."""
    radii: Float32[np.ndarray, "P"]
    """Half the spacing of the samples, metres."""

    def __len__(self) -> int:
        return len(self.positions)

    def take(self, kept: Bool[np.ndarray, "P"]) -> Points:
        """Return some of the points."""
        return Points(self.positions[kept], self.normals[kept], self.radii[kept])

    def joined(self, other: Points) -> Points:
        """Return these points, then the other ones."""
        return Points(
            np.concatenate([self.positions, other.positions]),
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.radii, other.radii]),
        )


@dataclass(slots=True)
class VoxelTable:
    """Sums over the points in each voxel; grows as needed."""

    edge: float
    """Metres."""
    used: int = 0
    """Voxels with points."""
    keys: Int64[np.ndarray, "C"] = field(default_factory=lambda: np.full(_CAPACITY, -1, np.int64))
    """Open-addressed keys, -1 free."""
    rows: Int32[np.ndarray, "C"] = field(default_factory=lambda: np.zeros(_CAPACITY, np.int32))
    """Row of each key."""
    sums: Float32[np.ndarray, "R 8"] = field(default_factory=lambda: np.zeros((_CAPACITY // 2, 8), np.float32))
    """Weight, weighted offset from the corner, weighted normal, least footprint."""
    corners: Int32[np.ndarray, "R 3"] = field(default_factory=lambda: np.zeros((_CAPACITY // 2, 3), np.int32))
    """Voxel indices."""

    def fill(self, add: Callable[..., tuple[int, int]], count: int, *arguments: object) -> None:
        """Run one of the adding kernels over `count` items, with more room whenever it stops for the lack of it."""
        from pipeline.construct.fusion.fuse_kernels import rehash

        done = 0
        while done < count:
            table = (self.keys, self.rows, self.sums, self.corners, self.used)
            self.used, done = add(*arguments, done, self.edge, *table)
            if done < count:
                keys, rows = np.full(2 * len(self.keys), -1, np.int64), np.zeros(2 * len(self.keys), np.int32)
                rehash(self.keys, self.rows, keys, rows)
                self.keys, self.rows = keys, rows
                self.sums = np.concatenate([self.sums, np.zeros_like(self.sums)])
                self.corners = np.concatenate([self.corners, np.zeros_like(self.corners)])

    def points(self) -> tuple[Points, Float32[np.ndarray, "P"]]:
        """Return each voxel's mean point, in the order they were met, and the summed weights."""
        sums = self.sums[: self.used].astype(np.float64)
        positions = self.corners[: self.used] * self.edge + sums[:, 1:4] / sums[:, :1]
        length = np.linalg.norm(sums[:, 4:7], axis=1, keepdims=True)
        normals = sums[:, 4:7] / np.maximum(length, 1e-30)
        radii = np.maximum(self.edge, sums[:, 7]) / 2
        found = Points(positions.astype(np.float32), normals.astype(np.float32), radii.astype(np.float32))
        return found, self.sums[: self.used, 0].copy()


@dataclass(frozen=True, slots=True)
class Agreement:
    """What all depth images say of P points."""

    offset_m: Float32[np.ndarray, "P"]
    """Mean signed way along the normal to the measured surface; 0 where no image has the point on its surface."""
    weight: Float32[np.ndarray, "P"]
    """Its weight."""
    agreed: Int16[np.ndarray, "P"]
    """Images with the point on their surface."""
    through: Int16[np.ndarray, "P"]
    """Images that look through it."""


def fit_surface(
    depth_m: Float32[np.ndarray, "h w"], camera: Camera, farthest_m: float = 8.0, *, threads: int = 1
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w 3"]]:
    """Return smoothed depth, 0 where there is no plane, and unit normals towards the camera, in its axes."""
    from pipeline.construct.fusion.fuse_kernels import fit_planes

    fitted, normals = np.empty_like(depth_m), np.empty((*depth_m.shape, 3), np.float32)
    parts = split(len(depth_m), 4 * threads)
    stride = max(1, round(TAP_ANGLE * float(camera.K[0, 0])))
    arguments = (stride, PIXEL_NOISE, farthest_m, fitted, normals)
    run_each(lambda k: fit_planes(depth_m, lens(camera), *parts[k], *arguments), len(parts), threads)
    return fitted, normals


def surface_points(
    depths: Callable[[], Iterator[tuple[Frame, Float32[np.ndarray, "h w"]]]],
    voxel_m: float,
    farthest_m: float,
    least_frames: int,
    *,
    threads: int = 1,
) -> Points:
    """Return one point in each voxel of the surfaces that at least `least_frames` depth images agree on.

    Args:
        depths: Gives the frames with their depth, the same each time; it is called 1 + `ROUNDS` times.
        voxel_m: Edge of a voxel, metres.
        farthest_m: Depth beyond this makes no points, metres.
        least_frames: Images that must confirm a point.
        threads: Threads.
    """
    from pipeline.construct.fusion.fuse_kernels import add_image, add_points

    table = VoxelTable(voxel_m)
    for frame, depth_m in depths():
        camera = frame.depth_lens
        fitted, normals = fit_surface(depth_m, camera, farthest_m, threads=threads)
        table.fill(add_image, depth_m.size, fitted, normals, lens(camera), camera.camera_to_world)
    points, _ = table.points()
    for _ in range(ROUNDS):
        found = agreement(points, depths(), threads=threads)
        moved = points.positions + points.normals * found.offset_m[:, None]
        kept = (found.agreed >= least_frames) & (found.through <= LOOKED_THROUGH * found.agreed)
        table = VoxelTable(voxel_m)
        arguments = (moved[kept], points.normals[kept], found.weight[kept], 2 * points.radii[kept])
        table.fill(add_points, int(kept.sum()), *arguments)
        points, _ = table.points()
    return points


def agreement(
    points: Points, depths: Iterator[tuple[Frame, Float32[np.ndarray, "h w"]]], *, threads: int = 1
) -> Agreement:
    """Return what depth images say of the points; one image is held at a time."""
    from pipeline.construct.fusion.fuse_kernels import compare_depth

    count = len(points)
    offsets, weights = np.zeros((2, count), np.float32)
    agreed, through = np.zeros((2, count), np.int16)
    parts = split(count, 4 * threads)
    for frame, depth_m in depths:
        camera = frame.depth_lens
        image = (depth_m, lens(camera), camera.world_to_camera, SAME_SURFACE, offsets, weights, agreed, through)

        def work(k: int, image: tuple[object, ...] = image) -> None:
            compare_depth(points.positions, points.normals, *parts[k], *image)

        run_each(work, len(parts), threads)
    offset_m = np.divide(offsets, weights, out=np.zeros_like(offsets), where=weights > 0)
    return Agreement(offset_m, weights, agreed, through)


def lens(camera: Camera) -> Float64[np.ndarray, "4"]:
    """Return fx, fy, cx, cy, as the kernels take them."""
    return np.array([camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]])
