"""Planes through depth, sums in voxels and agreement with depth images, each against a plain computation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.construct.fusion import fuse_surface
from pipeline.construct.fusion.fuse_fill import grown_together
from pipeline.construct.fusion.fuse_kernels import add_points
from pipeline.construct.fusion.fuse_surface import Points, VoxelTable, agreement, fit_surface
from tests.construct.posed_frames import plate_depth, plate_frames, room_frames
from tests.scene import box_room


def test_fitted_planes_are_the_walls_and_their_normals() -> None:
    camera = box_room.cameras(width=128, height=72)[0]
    exact = box_room.depth_m(camera)
    fitted, normals = fit_surface(exact.astype(np.float32), camera)
    world = normals @ camera.world_to_camera[:, :3]
    points = box_room.world_points(camera, exact)
    wall = np.stack([np.abs(points), np.abs(box_room.HIGH - points)])
    nearest = wall.min(axis=(0, 3)) < 1e-9
    flat = np.sort(wall.min(axis=0), axis=-1)[..., 1] > 0.4  # no other wall within the window
    assert flat.sum() > 2000
    assert nearest.all()
    assert (fitted[flat] > 0).mean() > 0.99  # a few at the border have too few neighbours
    flat &= fitted > 0
    np.testing.assert_allclose(fitted[flat], exact[flat], rtol=1e-5)
    axis = wall.min(axis=0).argmin(axis=-1)
    along = np.take_along_axis(world, axis[..., None], axis=-1)[..., 0]
    inwards = np.where(np.take_along_axis(points, axis[..., None], axis=-1)[..., 0] < 1e-6, 1.0, -1.0)
    np.testing.assert_allclose(along[flat], inwards[flat], atol=1e-3)


def test_fitted_planes_do_not_bridge_an_edge() -> None:
    lens = plate_frames()[1].depth_lens
    depth, plate = plate_depth(lens)
    fitted, _ = fit_surface(depth.astype(np.float32), lens)
    np.testing.assert_allclose(fitted[fitted > 0], depth[fitted > 0], rtol=1e-5)
    assert (fitted[plate] > 0).mean() > 0.9


def test_fitted_planes_are_the_same_for_any_number_of_threads() -> None:
    camera = box_room.cameras()[1]
    depth = box_room.depth_m(camera).astype(np.float32)
    for one, three in zip(fit_surface(depth, camera), fit_surface(depth, camera, threads=3), strict=True):
        np.testing.assert_array_equal(one, three)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.01, 0.3, 2.0]))
def test_voxel_means_are_those_of_a_plain_sum(seed: int, edge: float) -> None:
    rng = np.random.default_rng(seed)
    count = 400
    positions = rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    normals = np.tile(np.array([[0, 0, 1.0]], np.float32), (count, 1))
    weights, footprints = rng.uniform(0.1, 2, (2, count)).astype(np.float32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fuse_surface, "_CAPACITY", 8)  # it has to grow
        table = VoxelTable(edge)
        table.keys, table.rows = np.full(8, -1, np.int64), np.zeros(8, np.int32)
        table.sums, table.corners = np.full((4, 8), 7.0, np.float32), np.zeros((4, 3), np.int32)
    table.fill(add_points, count, positions, normals, weights, footprints)
    points, summed = table.points()
    cells, order, inverse = np.unique(
        np.floor(positions.astype(np.float64) / edge), axis=0, return_index=True, return_inverse=True
    )
    assert len(points) == len(cells)
    rank = np.argsort(np.argsort(order))[inverse.ravel()]  # voxels come in the order they are met
    total = np.bincount(rank, weights)
    np.testing.assert_allclose(summed, total, rtol=1e-5)
    for axis in range(3):
        mean = np.bincount(rank, weights * positions[:, axis].astype(np.float64)) / total
        np.testing.assert_allclose(points.positions[:, axis], mean, atol=1e-6 + 1e-6 * edge)
    least = np.full(len(cells), np.inf)
    np.minimum.at(least, rank, footprints)
    np.testing.assert_allclose(points.radii, np.maximum(edge, least) / 2, rtol=1e-6)


def test_two_sides_of_a_thin_plate_stay_apart() -> None:
    positions = np.zeros((4, 3), np.float32)
    normals = np.array([[0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, -1]], np.float32)
    table = VoxelTable(0.1)
    table.fill(add_points, 4, positions, normals, *np.ones((2, 4), np.float32))
    points, summed = table.points()
    np.testing.assert_array_equal(points.normals, normals[:2])
    np.testing.assert_array_equal(summed, [2, 2])


def test_agreement_tells_on_the_surface_looked_through_and_hidden_apart() -> None:
    frames = plate_frames()
    wall, floating, behind = [0.9, 0.6, 2.02], [0.5, 0.35, 1.5], [0.0, 0.0, 1.5]
    positions = np.array([wall, floating, behind], np.float32)
    points = Points(positions, np.tile(np.array([[0, 0, -1]], np.float32), (3, 1)), np.full(3, 0.01, np.float32))
    shown = [f.depth_lens.project(positions[:1].astype(float))[0][0] for f in frames]
    assert all((pixel >= 2).all() and (pixel < (158, 118)).all() for pixel in shown[1:]), "three frames show the wall"
    found = agreement(points, ((f, f.read_depth()) for f in frames))
    assert found.agreed.tolist() == [sum((p >= 0).all() and (p < (160, 120)).all() for p in shown), 0, 0]
    assert found.through[1] >= 3
    assert found.through.tolist()[::2] == [0, 0]
    # The wall is 2 cm nearer than the point, along its normal.
    np.testing.assert_allclose(found.offset_m, [0.02, 0, 0], atol=1e-5)


def test_agreement_is_the_same_for_any_number_of_threads() -> None:
    frames = room_frames(0.02)
    rng = np.random.default_rng(0)
    positions = rng.uniform([0, 0, 0], box_room.HIGH, (500, 3)).astype(np.float32)
    normals = rng.normal(size=(500, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = Points(positions, normals, np.full(500, 0.01, np.float32))
    one, three = (agreement(points, ((f, f.read_depth()) for f in frames), threads=n) for n in (1, 3))
    for name in ("offset_m", "weight", "agreed", "through"):
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 13), st.integers(1, 13), st.floats(0.05, 1.0))
def test_grown_values_keep_the_known_and_stay_between_them(seed: int, height: int, width: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    values, known = rng.uniform(1, 5, (height, width)), rng.random((height, width)) < share
    known[rng.integers(height), rng.integers(width)] = True
    grown = grown_together(np.where(known, values, 0.0), known)
    np.testing.assert_array_equal(grown[known], values[known])
    assert grown.min() >= values[known].min() - 1e-9
    assert grown.max() <= values[known].max() + 1e-9
