"""Leaving out what lies right behind a flat thing: a wall behind a picture, a cabinet's front behind its drawers.

Splats are blended in the order of their centres, so a big disc of a wall beside a thin picture would be
drawn over it from some directions. What a cover hides is therefore cut out of the surface behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pipeline.scene.procedural.shape import Joins, Kind, Shape

BEHIND_M = 0.026
"""A cover hides what lies up to this far behind it: past a baseboard or a drawer front, not a board's other side."""
INSCRIBED = 0.68
"""Half side of the square inside a round outline, relative to the outline's half axes."""
EDGE_M = 0.003
"""Width of surface kept under a cover's edge."""
LEAST_M = 0.02
"""Smaller covers are not worth a hole."""

Rect = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Faces:
    """n axis-aligned rectangles that hide what is behind them."""

    surface: Int[np.ndarray, "n"]
    """Where each is found in its shape."""
    axis: Int[np.ndarray, "n"]
    """Axis of the normal."""
    sign: Int[np.ndarray, "n"]
    """Direction of the normal along that axis: 1 or -1."""
    low: Float[np.ndarray, "n 3"]
    """Lowest corner, metres; on `axis`, where it lies."""
    high: Float[np.ndarray, "n 3"]
    """Highest corner, metres."""


def covers_of(shape: Shape) -> Faces:
    """Return the axis-aligned rectangles of a shape and the squares inside its round faces, but not the smallest."""
    quads = _rectangles(shape)
    kinds, frames = np.array(shape.kinds), np.stack(shape.frames)
    axis = np.abs(frames[:, 3]).argmax(axis=1)
    along = np.take_along_axis(frames[:, 3], axis[:, None], axis=1)[:, 0]
    discs = np.flatnonzero((kinds == Kind.DISC) & (np.abs(along) > 0.999))
    half = np.hypot(frames[discs, 1], frames[discs, 2]) * INSCRIBED
    low = np.concatenate([quads.low, frames[discs, 0] - half])
    high = np.concatenate([quads.high, frames[discs, 0] + half])
    wide = np.sort(high - low, axis=1)[:, 1] > LEAST_M
    return Faces(
        np.concatenate([quads.surface, discs])[wide],
        np.concatenate([quads.axis, axis[discs]])[wide],
        np.concatenate([quads.sign, np.sign(along[discs]).astype(int)])[wide],
        low[wide],
        high[wide],
    )


def cut(shape: Shape, covers: Faces) -> Shape:
    """Return the shape without the parts of its axis-aligned rectangles that the covers hide."""
    quads = _rectangles(shape)
    rows = np.arange(len(quads.axis))
    ahead = (covers.low + covers.high)[:, quads.axis].T / 2 - quads.low[rows, quads.axis][:, None]
    ahead = ahead * quads.sign[:, None]
    meets = (covers.low[None] < quads.high[:, None]) & (covers.high[None] > quads.low[:, None])
    meets[rows, :, quads.axis] = True
    same = (quads.axis[:, None] == covers.axis) & (quads.sign[:, None] == covers.sign)
    hiding = same & meets.all(axis=2) & (ahead > 1e-6) & (ahead <= BEHIND_M)
    hidden_by = {int(quads.surface[row]): np.flatnonzero(hiding[row]) for row in np.flatnonzero(hiding.any(axis=1))}
    result = Shape()
    columns = (shape.kinds, shape.frames, shape.tapers, shape.paints, shape.joins, shape.details)
    for index, (kind, frame, taper, paint, joins, detail) in enumerate(zip(*columns, strict=True)):
        if index not in hidden_by:
            result.add(Kind(kind), frame, paint, taper, joins, detail)
            continue
        u, v = frame[1] - frame[0], frame[2] - frame[0]
        a, b = int(np.abs(u).argmax()), int(np.abs(v).argmax())
        pieces: list[tuple[Rect, Joins]] = [((0.0, 0.0, 1.0, 1.0), joins)]
        for cover in hidden_by[index]:
            u0, u1 = sorted(((covers.low[cover, a] - frame[0, a]) / u[a], (covers.high[cover, a] - frame[0, a]) / u[a]))
            v0, v1 = sorted(((covers.low[cover, b] - frame[0, b]) / v[b], (covers.high[cover, b] - frame[0, b]) / v[b]))
            du, dv = EDGE_M / abs(u[a]), EDGE_M / abs(v[b])
            hole = (u0 + du * (u0 > 0), v0 + dv * (v0 > 0), u1 - du * (u1 < 1), v1 - dv * (v1 < 1))
            pieces = [part for piece in pieces for part in rectangle_without(*piece, hole)]
        for (u0, v0, u1, v1), piece_joins in pieces:
            corners = np.stack([frame[0] + s * u + t * v for t in (v0, v1) for s in (u0, u1)])
            result.add(Kind.QUAD, corners, paint, taper, piece_joins, detail)
    return result


def _rectangles(shape: Shape) -> Faces:
    """The quads of a shape that are rectangles along two axes."""
    frames = np.stack(shape.frames)
    u, v = frames[:, 1] - frames[:, 0], frames[:, 2] - frames[:, 0]
    a, b = np.abs(u).argmax(axis=1), np.abs(v).argmax(axis=1)
    off_axis = np.abs(u).sum(axis=1) - np.abs(u).max(axis=1) + np.abs(v).sum(axis=1) - np.abs(v).max(axis=1)
    skew = np.abs(frames[:, 3] - frames[:, 2] - u).max(axis=1)
    straight = (np.array(shape.kinds) == Kind.QUAD) & (a != b) & (off_axis + skew < 1e-9)
    rows = np.flatnonzero(straight)
    a, b = a[rows], b[rows]
    # The normal u x v points up its axis when (a, b) is (x, y), (y, z) or (z, x) and both sides run upwards.
    turn = np.where((b - a) % 3 == 1, 1, -1)
    sign = np.sign(u[rows, a] * v[rows, b]).astype(int) * turn
    return Faces(rows, 3 - a - b, sign, frames[rows].min(axis=1), frames[rows].max(axis=1))


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
