"""A ScanNet scan (mesh, labels, segments, aggregation) to a scene with categories, instances and a camera path."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int32, UInt8

from pipeline.construct.mesh.free_space import look_around, map_floor, walk
from pipeline.construct.mesh.mesh_ply import Mesh, read_mesh, read_vertex_labels
from pipeline.construct.mesh.mesh_surfels import density_surfels, vertex_surfels
from pipeline.construct.mesh.scannet_labels import ScanNetLabels, read_axis_alignment, read_labels
from pipeline.construct.mesh.support import state_support
from pipeline.geometry import Camera
from pipeline.scene import Scene, Semantics, View
from pipeline.scene.color_names import COLOR_NAMES, name_colors
from pipeline.scene.objects import SceneObject
from schemas.errors import InputError

FIELD_OF_VIEW_DEG = 67.0
"""Horizontal, of a phone held upright in landscape."""
MESH_ENDING = "_vh_clean_2.ply"
_OUTLIERS = 0.5
"""Percent of an object's vertices left outside its box at each end of an axis: segmentation spills over edges."""

_ISLAND_SHARE = 0.25
"""Size of an island, against an object's largest part, from which it counts as part of the object wherever it is..."""
_ISLAND_M = 0.25
"""... and the distance up to which smaller ones do."""


class ScannetScene(NamedTuple):
    """A scan as a scene."""

    scene: Scene
    """Gaussians, generated views, categories and instances."""
    objects: tuple[SceneObject, ...]
    """Annotated objects, structure included, by objectId."""


def build_scannet_mesh(
    directory: str | Path,
    *,
    density: float | None = None,
    views: int = 120,
    width: int = 320,
    height: int = 240,
    seed: int = 0,
) -> ScannetScene:
    """Return the scene of a ScanNet scan, in the scan's own (unaligned) coordinates.

    Categories are the raw labels of the aggregation, instances its objectIds; vertices nobody labelled are -1.
    The scan ships poses only with its frames, so views are a generated walk in free space.

    Args:
        directory: Folder of one scan: `*_vh_clean_2.ply`, `*_vh_clean_2.labels.ply` (optional, checked),
            `*_vh_clean_2.0.010000.segs.json`, `*.aggregation.json`, `*.txt`.
        density: Gaussians per square metre; None makes one per vertex.
        views: Views of the generated path, at least 1.
        width: View width, pixels.
        height: View height, pixels.
        seed: Seed of the path and of the samples.

    Raises:
        InputError: A file or field is missing, counts differ, or there is nowhere to stand.
    """
    if views < 1:
        raise InputError("build", field="views", expected="at least 1", found=views)
    folder = Path(directory)
    name, mesh, labels, yaw = read_scan(folder)
    path_rng, sample_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    surfels = vertex_surfels(mesh) if density is None else density_surfels(mesh, density, sample_rng)
    objects, floor_z = scan_objects(mesh, labels, yaw)
    semantics = Semantics(labels.vocabulary, labels.category[surfels.vertex], None, labels.instance[surfels.vertex])
    scene = Scene(
        name=name,
        gaussians=surfels.gaussians,
        views=_views(mesh, floor_z, path_rng, views, width, height),
        semantics=semantics,
        warnings=labels.warnings,
    )
    return ScannetScene(scene, objects)


def scan_objects(mesh: Mesh, labels: ScanNetLabels, yaw: float | None) -> tuple[tuple[SceneObject, ...], float]:
    """Return a scan's annotated objects by objectId, and the height of its floor, metres.

    Args:
        mesh: The scan's mesh.
        labels: Its annotation.
        yaw: Yaw of its axis alignment, radians; None takes the main direction of the walls.
    """
    box_yaw = main_direction(mesh) if yaw is None else -yaw
    points = {identity: main_part(mesh, labels, identity) for identity in labels.names}
    floors = [points[identity][:, 2] for identity, category in labels.names.items() if category == "floor"]
    floor_z = float(np.median(np.concatenate(floors)) if floors else np.percentile(mesh.vertices[:, 2], 2))
    return state_support(_objects(mesh, labels, points, box_yaw), points, floor_z), floor_z


def main_direction(mesh: Mesh) -> float:
    """Return the yaw, 0 to pi/2, that most of the upright surface is aligned with (walls meet at right angles)."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    weight = np.linalg.norm(cross, axis=1)
    upright = np.abs(cross[:, 2]) < 0.2 * weight
    angle = np.arctan2(cross[upright, 1], cross[upright, 0])
    # Four times the angle is the same for all four walls of a room, so their mean direction is the room's.
    mean = np.angle((weight[upright] * np.exp(4j * angle)).sum()) / 4
    return float(mean % (np.pi / 2))


def read_scan(folder: Path) -> tuple[str, Mesh, ScanNetLabels, float | None]:
    """Return a scan's name, mesh, annotation, and the yaw of its axis alignment (None where its text file has none).

    Raises:
        InputError: A file or field is missing, or counts differ.
    """
    if not folder.is_dir():
        raise InputError(folder, expected="a folder with one ScanNet scan", found="no such folder")
    meshes = sorted(folder.glob(f"*{MESH_ENDING}"))
    if len(meshes) != 1:
        found = ", ".join(path.name for path in meshes) or "none"
        raise InputError(folder, expected=f"one file *{MESH_ENDING}", found=found)
    name = meshes[0].name.removesuffix(MESH_ENDING)
    mesh = read_mesh(meshes[0])
    labels_file = folder / f"{name}_vh_clean_2.labels.ply"
    if labels_file.exists():
        count = len(read_vertex_labels(labels_file))
        if count != len(mesh.vertices):
            raise InputError(labels_file, field="vertex", expected=f"{len(mesh.vertices)} rows", found=count)
    labels = read_labels(
        folder / f"{name}_vh_clean_2.0.010000.segs.json", folder / f"{name}.aggregation.json", len(mesh.vertices)
    )
    return name, mesh, labels, read_axis_alignment(folder / f"{name}.txt")


def main_part(mesh: Mesh, labels: ScanNetLabels, identity: int) -> Float[np.ndarray, "k 3"]:
    """Return an object's vertices without small far-off islands, which annotators took along by mistake."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    own = np.flatnonzero(labels.instance == identity)
    slot = np.full(len(mesh.vertices), -1)
    slot[own] = np.arange(len(own))
    edges = slot[np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])]
    edges = edges[(edges >= 0).all(axis=1)]
    graph = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(own), len(own)))
    _, part = connected_components(graph, directed=False)
    sizes = np.bincount(part)
    points = mesh.vertices[own].astype(np.float64)
    tree = cKDTree(points[part == sizes.argmax()])
    keep = np.isin(part, np.flatnonzero(sizes >= _ISLAND_SHARE * sizes.max()))
    keep |= tree.query(points)[0] <= _ISLAND_M
    return points[keep]


def _objects(
    mesh: Mesh, labels: ScanNetLabels, parts: dict[int, Float[np.ndarray, "k 3"]], yaw: float
) -> tuple[SceneObject, ...]:
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    objects = []
    for identity, category in labels.names.items():
        own, points = labels.instance == identity, parts[identity]
        local = np.concatenate([points[:, :2] @ turn, points[:, 2:]], axis=1)
        low, high = np.percentile(local, [_OUTLIERS, 100 - _OUTLIERS], axis=0)
        middle, half = (low + high) / 2, (high - low) / 2
        x, y = turn @ middle[:2]
        color = plain_color(mesh.colors[own])
        objects.append(
            SceneObject(identity, category, color, (float(x), float(y), float(middle[2])), _triple(half), float(yaw))
        )
    return tuple(objects)


def plain_color(colors: UInt8[np.ndarray, "k 3"]) -> str:
    """Return the colour name most vertices carry, or "" where it does not plainly lead: scans mix light and paint."""
    share = np.bincount(name_colors(colors / 255.0), minlength=len(COLOR_NAMES)) / len(colors)
    second, first = np.sort(share)[-2:]
    return COLOR_NAMES[int(share.argmax())] if first >= 0.4 and first - second >= 0.15 else ""


def _triple(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _views(
    mesh: Mesh, floor_z: float, rng: np.random.Generator, count: int, width: int, height: int
) -> tuple[View, ...]:
    floor = map_floor(_surface_points(mesh), floor_z)
    focal = width / 2 / np.tan(np.deg2rad(FIELD_OF_VIEW_DEG) / 2)
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    poses = look_around(floor, walk(floor, count, rng), rng)
    return tuple(View(f"{i:04d}", Camera(K, pose, width, height)) for i, pose in enumerate(poses))


def _surface_points(mesh: Mesh, spacing_m: float = 0.04) -> Float[np.ndarray, "P 3"]:
    """Return points on the mesh no farther apart than `spacing_m`: corners, and grids on larger triangles."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    pieces: Int32[np.ndarray, "m"] = np.clip(np.ceil(longest / spacing_m), 1, 64).astype(np.int32)
    points = [mesh.vertices.astype(np.float64)]
    for count in np.unique(pieces[pieces > 1]).tolist():
        chosen = corners[pieces == count]
        grid = [(a, b) for a in range(count + 1) for b in range(count + 1 - a)]
        weights = np.array([(a, b, count - a - b) for a, b in grid]) / count
        points.append(np.einsum("kc,tcd->tkd", weights, chosen).reshape(-1, 3))
    return np.concatenate(points)
