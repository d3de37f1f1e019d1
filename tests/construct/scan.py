"""A tiny synthetic scan in ScanNet's files: a room with a table, a box on it, a ball under it, and a cabinet."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

NAME = "scene9999_00"
YAW = 0.35
"""Turn of the room about the vertical axis, radians: real scans are not aligned."""
SPACING_M = 0.08

PARTS: tuple[tuple[str, tuple[float, float, float], tuple[float, float, float], tuple[int, int, int]], ...] = (
    ("floor", (0.0, 0.0, 0.0), (4.0, 3.0, 0.0), (150, 110, 70)),
    ("wall", (0.0, 0.0, 0.0), (4.0, 0.0, 2.4), (220, 220, 215)),
    ("wall", (0.0, 3.0, 0.0), (4.0, 3.0, 2.4), (220, 220, 215)),
    ("wall", (0.0, 0.0, 0.0), (0.0, 3.0, 2.4), (220, 220, 215)),
    ("wall", (4.0, 0.0, 0.0), (4.0, 3.0, 2.4), (220, 220, 215)),
    ("table", (2.6, 1.9, 0.68), (3.8, 2.8, 0.74), (120, 80, 45)),
    ("box", (3.0, 2.2, 0.74), (3.4, 2.5, 1.0), (190, 30, 30)),
    ("ball", (3.0, 2.2, 0.0), (3.3, 2.5, 0.3), (30, 60, 190)),
    ("cabinet", (0.05, 0.05, 0.0), (0.5, 1.2, 1.4), (40, 120, 50)),
)
"""Label, low and high corner (metres, before the turn) and colour; objectId is the position in this list."""


def patch(low: np.ndarray, high: np.ndarray, axis: int, at: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the grid of vertices and triangles of one axis-aligned rectangle."""
    across = [a for a in range(3) if a != axis]
    counts = [max(2, int(np.ceil((high[a] - low[a]) / SPACING_M)) + 1) for a in across]
    u, v = np.meshgrid(*[np.linspace(low[a], high[a], n) for a, n in zip(across, counts, strict=True)], indexing="ij")
    points = np.empty((u.size, 3))
    points[:, axis], points[:, across[0]], points[:, across[1]] = at, u.ravel(), v.ravel()
    corner = (np.arange(counts[0] - 1)[:, None] * counts[1] + np.arange(counts[1] - 1)).ravel()
    right, up = corner + 1, corner + counts[1]
    return points, np.concatenate([np.stack([corner, right, up], 1), np.stack([right, up + 1, up], 1)])


def build_arrays() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, colours, faces and the part of each vertex."""
    vertices, colors, faces, parts = [], [], [], []
    count = 0
    for number, (_, low_corner, high_corner, color) in enumerate(PARTS):
        low, high = np.array(low_corner), np.array(high_corner)
        for axis in range(3):
            for at in {low[axis], high[axis]}:
                if all(high[a] > low[a] for a in range(3) if a != axis):
                    points, triangles = patch(low, high, axis, at)
                    vertices.append(points)
                    faces.append(triangles + count)
                    colors.append(np.tile(np.array(color, np.uint8), (len(points), 1)))
                    parts.append(np.full(len(points), number))
                    count += len(points)
    cos, sin = np.cos(YAW), np.sin(YAW)
    turned = np.concatenate(vertices) @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    return (
        turned.astype(np.float32),
        np.concatenate(colors),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(parts),
    )


def ply_bytes(vertices: np.ndarray, colors: np.ndarray, faces: np.ndarray, labels: np.ndarray | None = None) -> bytes:
    """Return a binary PLY as ScanNet writes it."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")]
    if labels is not None:
        fields.append(("label", "<u2"))
    rows = np.zeros(len(vertices), fields)
    for axis, name in enumerate("xyz"):
        rows[name] = vertices[:, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        rows[name] = colors[:, channel]
    rows["alpha"] = 255
    lines = ["property float x", "property float y", "property float z"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue", "alpha")]
    if labels is not None:
        rows["label"] = labels
        lines.append("property ushort label")
    triangles = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", (3,))])
    triangles["n"], triangles["v"] = 3, faces
    header = ["ply", "format binary_little_endian 1.0", "comment made for a test", f"element vertex {len(vertices)}"]
    header += [*lines, f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    return ("\n".join(header) + "\n").encode() + rows.tobytes() + triangles.tobytes()


def write_scan(folder: Path) -> Path:
    """Write the scan's five files and return the folder."""
    vertices, colors, faces, parts = build_arrays()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{NAME}_vh_clean_2.ply").write_bytes(ply_bytes(vertices, colors, faces))
    (folder / f"{NAME}_vh_clean_2.labels.ply").write_bytes(ply_bytes(vertices, colors, faces, parts + 1))
    segments = {"sceneId": NAME, "segIndices": (parts * 10).tolist()}
    (folder / f"{NAME}_vh_clean_2.0.010000.segs.json").write_text(json.dumps(segments))
    groups = [{"id": n, "objectId": n, "label": part[0], "segments": [n * 10]} for n, part in enumerate(PARTS)]
    (folder / f"{NAME}.aggregation.json").write_text(json.dumps({"sceneId": NAME, "segGroups": groups}))
    (folder / f"{NAME}.txt").write_text("colorHeight = 968\nsceneType = Test\n")
    return folder
