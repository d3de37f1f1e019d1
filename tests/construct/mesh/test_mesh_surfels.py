"""Surfels: aligned with the surface, closed, and evenly spread."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.mesh.mesh_ply import Mesh
from pipeline.construct.mesh.mesh_surfels import SH_C0, THICKNESS_M, Surfels, density_surfels, vertex_surfels
from pipeline.geometry import Camera, covariances, look_at, quats_to_rotations
from pipeline.render import render
from schemas.errors import InputError

SIZE_M, STEPS = 2.0, 26


@pytest.fixture(scope="module")
def sheet() -> Mesh:
    """A flat sheet at z = 0.5, red on one half and blue on the other."""
    steps = np.linspace(0, SIZE_M, STEPS)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.5)], 1).astype(np.float32)
    corner = (np.arange(STEPS - 1)[:, None] * STEPS + np.arange(STEPS - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + STEPS, corner + 1], 1),
            np.stack([corner + 1, corner + STEPS, corner + STEPS + 1], 1),
        ]
    )
    colors = np.where(x.ravel()[:, None] < SIZE_M / 2, [[200, 0, 0]], [[0, 0, 200]]).astype(np.uint8)
    return Mesh(vertices, colors, faces.astype(np.int32))


def both(mesh: Mesh) -> list[Surfels]:
    return [vertex_surfels(mesh), density_surfels(mesh, 400.0, np.random.default_rng(0))]


def test_surfels_lie_flat_in_the_surface(sheet: Mesh) -> None:
    for surfels in both(sheet):
        g = surfels.gaussians
        np.testing.assert_allclose(g.means[:, 2], 0.5, atol=1e-6)
        normals = quats_to_rotations(g.quats)[:, :, 2]
        np.testing.assert_allclose(np.abs(normals[:, 2]), 1.0, atol=1e-5)
        np.testing.assert_allclose(covariances(g.quats, g.log_scales)[:, 2, 2], THICKNESS_M**2, rtol=1e-3)


def test_surfels_take_the_colors_of_the_mesh(sheet: Mesh) -> None:
    for surfels in both(sheet):
        color = 0.5 + SH_C0 * surfels.gaussians.sh[:, 0]
        left = surfels.gaussians.means[:, 0] < 0.9
        np.testing.assert_allclose(color[left], np.broadcast_to([200 / 255, 0, 0], color[left].shape), atol=1e-5)


def test_surfels_know_the_vertex_they_belong_to(sheet: Mesh) -> None:
    for surfels in both(sheet):
        distance = np.linalg.norm(surfels.gaussians.means - sheet.vertices[surfels.vertex], axis=1)
        assert distance.max() <= SIZE_M / (STEPS - 1)


@pytest.mark.parametrize("tilt", [0.0, 0.8])
def test_surfels_close_the_surface(sheet: Mesh, tilt: float) -> None:
    middle = np.array([SIZE_M / 2, SIZE_M / 2, 0.5])
    eye = middle + 1.2 * np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    K = np.array([[150.0, 0, 60], [0, 150.0, 60], [0, 0, 1]])
    camera = Camera(K, look_at(eye, middle, np.array([0.0, 1.0, 0.0])), 120, 120)
    for surfels in both(sheet):
        alpha = render(surfels.gaussians, camera, ("alpha",)).alpha
        assert alpha is not None
        assert alpha[30:90, 30:90].min() > 0.9


def test_density_gives_the_count_asked_for_evenly(sheet: Mesh) -> None:
    surfels = density_surfels(sheet, 1000.0, np.random.default_rng(3))
    assert len(surfels.gaussians) == round(1000 * SIZE_M**2)
    quarter = (surfels.gaussians.means[:, :2] < SIZE_M / 2).all(axis=1).sum()
    assert abs(quarter - 1000) < 40


def test_vertex_surfels_leave_out_vertices_without_a_triangle() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [6, 6, 6]], np.float32)
    faces = np.array([[0, 1, 2], [4, 4, 4]], np.int32)
    surfels = vertex_surfels(Mesh(vertices, np.zeros((5, 3), np.uint8), faces))
    assert surfels.vertex.tolist() == [0, 1, 2]


@pytest.mark.parametrize("density", [0.0, -1.0, float("nan")])
def test_density_must_be_positive(sheet: Mesh, density: float) -> None:
    with pytest.raises(InputError, match="density"):
        density_surfels(sheet, density, np.random.default_rng(0))
