"""Surface-aligned Gaussians from a triangle mesh: flat along the normal, wide enough to close the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from pipeline.construct.mesh.mesh_ply import Mesh
from pipeline.geometry import rotations_to_quats
from pipeline.scene import Gaussians
from schemas.errors import InputError

SH_C0 = 0.28209479177387814
"""Zeroth spherical harmonic: colour = 0.5 + SH_C0 * coefficient."""
SPREAD = 0.85
"""Standard deviation in units of the neighbours' root mean square offset per axis. With neighbours one edge away that
is 0.57 edges: half an edge from a centre the weight is still 0.68, and the neighbours fill the rest."""
THICKNESS_M = 0.003
"""Standard deviation along the normal: thinner than a scan's noise, so that surfaces do not glow around edges."""
WIDEST_M = 0.15
"""Cap on the standard deviation along the surface; larger triangles of a cleaned scan belong to filled holes."""
NARROWEST_M = 0.004
"""Floor on the same, so that slivers stay visible."""
OPACITY_LOGIT = 5.0
"""Opacity 0.993: a surface hides what is behind it."""


@dataclass(frozen=True, slots=True)
class Surfels:
    """Gaussians on a mesh and where each came from."""

    gaussians: Gaussians
    """M flat Gaussians."""
    vertex: Int64[np.ndarray, "M"]
    """Mesh vertex whose labels the Gaussian takes: its own, or the nearest corner of its triangle."""


def vertex_surfels(mesh: Mesh) -> Surfels:
    """Return one Gaussian per vertex that some triangle with an area uses.

    Its axes and widths follow the offsets to the neighbouring vertices within the tangent plane.
    """
    positions = mesh.vertices.astype(np.float64)
    normals = _vertex_normals(mesh)
    used = np.flatnonzero(np.linalg.norm(normals, axis=1) > 0)
    first, second = _frame(normals[used])
    slot = np.full(len(positions), -1)
    slot[used] = np.arange(len(used))

    # Second moments of the neighbour offsets in each vertex's tangent plane: [uu, uv, vv] and the count.
    moments = np.zeros((len(used), 4))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        for start, end in ((mesh.faces[:, a], mesh.faces[:, b]), (mesh.faces[:, b], mesh.faces[:, a])):
            keep = slot[start] >= 0
            at = slot[start[keep]]
            offset = positions[end[keep]] - positions[start[keep]]
            u, v = (offset * first[at]).sum(axis=1), (offset * second[at]).sum(axis=1)
            for column, values in enumerate((u * u, u * v, v * v, np.ones(len(u)))):
                moments[:, column] += np.bincount(at, values, len(used))
    uu, uv, vv = (moments[:, :3] / moments[:, 3:]).T
    values, vectors = np.linalg.eigh(np.stack([uu, uv, uv, vv], axis=-1).reshape(-1, 2, 2))
    widths = SPREAD * np.sqrt(np.maximum(values, 0.0))
    axes = vectors[:, 0, :, None] * first[:, None] + vectors[:, 1, :, None] * second[:, None]
    normal = np.cross(axes[:, 0], axes[:, 1])
    gaussians = _flat(positions[used], axes[:, 0], axes[:, 1], normal, widths, mesh.colors[used] / 255.0)
    return Surfels(gaussians, used)


def density_surfels(mesh: Mesh, density: float, rng: np.random.Generator) -> Surfels:
    """Return Gaussians spread evenly over the surface, colours interpolated from the corners.

    Args:
        mesh: The mesh.
        density: Gaussians per square metre, above 0.
        rng: Source of the sample positions.

    Raises:
        InputError: The density is not positive or the mesh has no area.
    """
    if not density > 0:
        raise InputError("surfels", field="density", expected="Gaussians per square metre above 0", found=density)
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(cross, axis=1)
    total = double_area.sum() / 2
    if not total > 0:
        raise InputError("surfels", field="mesh", expected="triangles with an area", found="none")
    # Systematic sampling along the summed area: every patch gets its share to within one sample.
    count = max(1, round(total * density))
    steps = (np.arange(count) + rng.random()) / count * total
    face = np.minimum(np.searchsorted(np.cumsum(double_area / 2), steps, side="right"), len(double_area) - 1)
    u, v = rng.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)
    normal = cross[face] / np.maximum(double_area[face], 1e-30)[:, None]
    first, second = _frame(normal)
    colors = (weights[:, :, None] * mesh.colors[mesh.faces[face]]).sum(axis=1) / 255.0
    # Samples fall at random, so gaps are wider than on a mesh of the same density.
    widths = np.full((count, 2), SPREAD / np.sqrt(density))
    means = (weights[:, :, None] * corners[face]).sum(axis=1)
    gaussians = _flat(means, first, second, normal, widths, colors)
    return Surfels(gaussians, mesh.faces[face, weights.argmax(axis=1)].astype(np.int64))


def _flat(
    means: Float[np.ndarray, "M 3"],
    first: Float[np.ndarray, "M 3"],
    second: Float[np.ndarray, "M 3"],
    normal: Float[np.ndarray, "M 3"],
    widths: Float[np.ndarray, "M 2"],
    colors: Float[np.ndarray, "M 3"],
) -> Gaussians:
    widths = np.clip(widths, NARROWEST_M, WIDEST_M)
    scales = np.concatenate([widths, np.full((len(means), 1), THICKNESS_M)], axis=1)
    return Gaussians(
        means=means.astype(np.float32),
        quats=rotations_to_quats(np.stack([first, second, normal], axis=-1)).astype(np.float32),
        log_scales=np.log(scales).astype(np.float32),
        opacity_logits=np.full(len(means), OPACITY_LOGIT, np.float32),
        sh=((colors - 0.5) / SH_C0).astype(np.float32)[:, None, :],
    )


def _vertex_normals(mesh: Mesh) -> Float[np.ndarray, "n 3"]:
    """Return unit vertex normals, the mean of the faces' by area; zero where no face has an area."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.stack(
        [np.bincount(mesh.faces.ravel(), np.repeat(cross[:, axis], 3), len(mesh.vertices)) for axis in range(3)],
        axis=1,
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 1e-12)


def _frame(normals: Float[np.ndarray, "M 3"]) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, "M 3"]]:
    """Return two unit vectors that complete each normal to a right-handed frame (first x second = normal)."""
    helper = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(helper, normals)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    return first, np.cross(normals, first)
