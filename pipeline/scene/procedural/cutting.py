"""Cutting walls, floors and ceilings where flat things cover them.

Splats are blended in the order of their centres, so a big disc of a wall beside a thin picture would be
drawn over it from some directions. What lies behind a flat thing is therefore left out, with clean edges.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from pipeline.scene.procedural.shape import Kind, Shape
from pipeline.scene.procedural.things import Placed

THIN_M = 0.16
"""Things that stand out less than this from what they touch are cut out of it; nothing shows past thicker ones."""
REACH_M = 0.03
"""Largest distance from the cover's face to the surface it hides: skips past a baseboard of 1 cm."""
INSCRIBED = 0.68
"""Half side of the square inside a round outline, relative to the outline's half axes."""
EDGE_M = 0.004
"""Width of surface kept under a cover's edge."""

Rect = tuple[float, float, float, float]


def cut_structure(things: list[Placed]) -> list[Placed]:
    """Return the things with floors, walls and ceilings cut under the flat things they carry."""
    covers: dict[int, list[Placed]] = {}
    for thing in things:
        if is_flat(thing) and things[thing.host].model.category in ("floor", "wall", "ceiling") and _is_aligned(thing):
            covers.setdefault(thing.host, []).append(thing)
    result = list(things)
    for host, flat in covers.items():
        shape = _cut(things[host].model.shape, [_hole(thing) for thing in flat])
        result[host] = replace(things[host], model=replace(things[host].model, shape=shape))
    return result


def is_flat(thing: Placed) -> bool:
    """Return whether a thing lies flat on its host and is closed towards it."""
    across = 1 if thing.mount == "back" else 2
    return bool(thing.host >= 0 and thing.model.contact != "none" and thing.model.size[across] < THIN_M)


def _is_aligned(thing: Placed) -> bool:
    quarter = thing.yaw / (np.pi / 2)
    return abs(quarter - round(quarter)) < 1e-3


def _hole(thing: Placed) -> Float[np.ndarray, "2 3"]:
    """World box of what is hidden, thickened towards the host."""
    low, high = thing.model.bounds
    middle, half = (low + high) / 2, (high - low) / 2
    axis = {"base": 2, "back": 1, "top": 2}[thing.mount]
    inner = half * INSCRIBED if thing.model.contact == "ellipse" else half - EDGE_M
    inner[axis] = 0.0
    face = middle.copy()
    face[axis] = high[axis] if thing.mount == "top" else low[axis]
    corners = thing.to_world(np.stack([face - inner, face + inner]))
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    across = int(np.argmin(box[1] - box[0]))
    box[:, across] += (-REACH_M, REACH_M)
    return box


def _cut(shape: Shape, holes: list[Float[np.ndarray, "2 3"]]) -> Shape:
    """The shape with the holes taken out of its upright and level rectangles."""
    result = Shape()
    for kind, frame, paint in zip(shape.kinds, shape.frames, shape.paints, strict=True):
        assert kind == Kind.QUAD, "structure is made of quads only"
        u, v = frame[1] - frame[0], frame[2] - frame[0]
        a, b = int(np.abs(u).argmax()), int(np.abs(v).argmax())
        across = 3 - a - b
        pieces: list[Rect] = [(0.0, 0.0, 1.0, 1.0)]
        for low, high in holes:
            if low[across] <= frame[0, across] <= high[across]:
                u0, u1 = sorted(((low[a] - frame[0, a]) / u[a], (high[a] - frame[0, a]) / u[a]))
                v0, v1 = sorted(((low[b] - frame[0, b]) / v[b], (high[b] - frame[0, b]) / v[b]))
                pieces = [part for piece in pieces for part in _without(piece, (u0, v0, u1, v1))]
        for u0, v0, u1, v1 in pieces:
            corners = [frame[0] + s * u + t * v for t in (v0, v1) for s in (u0, u1)]
            result.quad(np.array(corners), paint)
    return result


def _without(piece: Rect, hole: Rect) -> list[Rect]:
    """A rectangle (low u, low v, high u, high v) minus another: up to four rectangles."""
    u0, v0, u1, v1 = piece
    hu0, hv0, hu1, hv1 = max(u0, hole[0]), max(v0, hole[1]), min(u1, hole[2]), min(v1, hole[3])
    if hu0 >= hu1 or hv0 >= hv1:
        return [piece]
    parts = [(u0, v0, u1, hv0), (u0, hv1, u1, v1), (u0, hv0, hu0, hv1), (hu1, hv0, u1, hv1)]
    return [part for part in parts if part[2] - part[0] > 1e-6 and part[3] - part[1] > 1e-6]
