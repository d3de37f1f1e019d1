"""Leaving out what lies right behind a flat thing: a wall behind a picture, a cabinet's front behind its drawers.

Splats are blended in the order of their centres, so a big disc of a wall beside a thin picture would be
drawn over it from some directions. What a cover hides is therefore cut out of the surface behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pipeline.scene.procedural.shape import Joins, Kind, Shape

BEHIND_M = 0.026
"""A cover hides what lies up to this far behind it: past a baseboard or a drawer's front, not to a board's other side."""
INSCRIBED = 0.68
"""Half side of the square inside a round outline, relative to the outline's half axes."""
EDGE_M = 0.003
"""Width of surface kept under a cover's edge."""
LEAST_M = 0.02
"""Smaller covers are not worth a hole."""

Rect = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Cover:
    """An axis-aligned rectangle that hides what is behind it."""

    axis: int
    """Axis of its normal."""
    sign: int
    """Direction of its normal along that axis."""
    low: Float[np.ndarray, "3"]
    """Lowest corner, metres; on `axis`, where it lies."""
    high: Float[np.ndarray, "3"]
    """Highest corner, metres."""


def covers_of(shape: Shape) -> list[Cover]:
    """Return the axis-aligned rectangles of a shape, and the squares inside its round faces."""
    covers = []
    for kind, frame in zip(shape.kinds, shape.frames, strict=True):
        if kind == Kind.QUAD:
            low, high = frame.min(axis=0), frame.max(axis=0)
            axis = int((high - low).argmin())
            if _is_rectangle(frame) and high[axis] - low[axis] < 1e-9:
                normal = np.cross(frame[1] - frame[0], frame[2] - frame[0])
                covers.append(Cover(axis, 1 if normal[axis] > 0 else -1, low, high))
        elif kind == Kind.DISC:
            axis = int(np.abs(frame[3]).argmax())
            if abs(frame[3, axis]) > 0.999:
                half = np.hypot(frame[1], frame[2]) * INSCRIBED
                covers.append(Cover(axis, 1 if frame[3, axis] > 0 else -1, frame[0] - half, frame[0] + half))
    wide = [np.sort(cover.high - cover.low)[1] > LEAST_M for cover in covers]
    return [cover for cover, keep in zip(covers, wide, strict=True) if keep]


def cut(shape: Shape, covers: list[Cover]) -> Shape:
    """Return the shape without the parts of its axis-aligned rectangles that the covers hide."""
    if not covers:
        return shape
    axes = np.array([cover.axis for cover in covers])
    signs = np.array([cover.sign for cover in covers])
    lows, highs = np.stack([cover.low for cover in covers]), np.stack([cover.high for cover in covers])
    result = Shape()
    surfaces = zip(shape.kinds, shape.frames, shape.tapers, shape.paints, shape.joins, strict=True)
    for kind, frame, taper, paint, joins in surfaces:
        hiding = np.zeros(0, int)
        if kind == Kind.QUAD and _is_rectangle(frame):
            low, high = frame.min(axis=0), frame.max(axis=0)
            axis = int((high - low).argmin())
            if high[axis] - low[axis] < 1e-9:
                normal = np.cross(frame[1] - frame[0], frame[2] - frame[0])
                sign = 1 if normal[axis] > 0 else -1
                ahead = (lows[:, axis] + highs[:, axis]) / 2 * sign - low[axis] * sign
                across = [k for k in range(3) if k != axis]
                meets = ((lows[:, across] < high[across]) & (highs[:, across] > low[across])).all(axis=1)
                near = (ahead > 1e-6) & (ahead <= BEHIND_M)
                hiding = np.flatnonzero((axes == axis) & (signs == sign) & near & meets)
        if not len(hiding):
            result.add(Kind(kind), frame, paint, taper, joins)
            continue
        u, v = frame[1] - frame[0], frame[2] - frame[0]
        a, b = int(np.abs(u).argmax()), int(np.abs(v).argmax())
        pieces: list[tuple[Rect, Joins]] = [((0.0, 0.0, 1.0, 1.0), joins)]
        for index in hiding:
            u0, u1 = sorted(((lows[index, a] - frame[0, a]) / u[a], (highs[index, a] - frame[0, a]) / u[a]))
            v0, v1 = sorted(((lows[index, b] - frame[0, b]) / v[b], (highs[index, b] - frame[0, b]) / v[b]))
            du, dv = EDGE_M / abs(u[a]), EDGE_M / abs(v[b])
            hole = (u0 + du * (u0 > 0), v0 + dv * (v0 > 0), u1 - du * (u1 < 1), v1 - dv * (v1 < 1))
            pieces = [part for piece in pieces for part in rectangle_without(*piece, hole)]
        for (u0, v0, u1, v1), piece_joins in pieces:
            corners = np.stack([frame[0] + s * u + t * v for t in (v0, v1) for s in (u0, u1)])
            result.add(Kind.QUAD, corners, paint, taper, piece_joins)
    return result


def _is_rectangle(frame: Float[np.ndarray, "4 3"]) -> bool:
    """Whether a quad is a parallelogram; with sides along two axes it then is a rectangle."""
    return bool(np.abs(frame[3] - frame[2] - frame[1] + frame[0]).max() < 1e-9)


def rectangle_without(piece: Rect, joins: Joins, hole: Rect) -> list[tuple[Rect, Joins]]:
    """Return a rectangle (low u, low v, high u, high v) minus another: up to eight rectangles around the hole.

    Sides that face the hole are free, sides between the parts are joined, outer sides stay as they were.
    """
    u0, v0, u1, v1 = piece
    h0, k0, h1, k1 = max(u0, hole[0]), max(v0, hole[1]), min(u1, hole[2]), min(v1, hole[3])
    if h1 - h0 < 1e-6 or k1 - k0 < 1e-6:
        return [(piece, joins)]
    us, vs = (u0, h0, h1, u1), (v0, k0, k1, v1)
    parts = []
    for i in range(3):
        for j in range(3):
            if (i, j) == (1, 1) or us[i + 1] - us[i] < 1e-6 or vs[j + 1] - vs[j] < 1e-6:
                continue
            low_u = joins[0] if i == 0 else not (i == 2 and j == 1)
            high_u = joins[1] if i == 2 else not (i == 0 and j == 1)
            low_v = joins[2] if j == 0 else not (j == 2 and i == 1)
            high_v = joins[3] if j == 2 else not (j == 0 and i == 1)
            parts.append(((us[i], vs[j], us[i + 1], vs[j + 1]), (low_u, high_u, low_v, high_v)))
    return parts


def without_hidden(shape: Shape) -> Shape:
    """Return the shape with its own covered parts cut out."""
    return cut(shape, covers_of(shape))
