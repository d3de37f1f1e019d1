"""Floors, ceilings and walls with their doorways, one instance a room and side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pipeline.scene.procedural.cutting import rectangle_without
from pipeline.scene.procedural.layout import DOOR_HEIGHT_M, WALL_M, XY, Doorway, Layout, Room
from pipeline.scene.procedural.paint import PALETTE, RGB, Paint, Texture, mix, pick
from pipeline.scene.procedural.shape import Kind, Shape
from pipeline.scene.procedural.things import Model

SEAL_M = 0.03
"""How far floors, walls and ceilings run on behind each other, so that no light comes in along the edges of a room."""
DOORSIDE_M, DOORSIDE_DETAIL = 0.4, 0.5
"""Width of wall beside a doorway that gets finer discs, and how much finer: big discs turn to fog when passed close."""
BASEBOARD_M = (0.01, 0.08)
"""Thickness and height of the strip along the foot of a wall."""


@dataclass(frozen=True, slots=True)
class Side:
    """One of the four walls of a room."""

    name: str
    """south (low y), north, west (low x) or east."""
    axis: int
    """0 when it stands at constant x, 1 at constant y."""
    inward: int
    """Direction of its normal along that axis, into the room: 1 or -1."""
    yaw: float
    """Turn of a thing whose back is against it, radians."""

    def plane(self, room: Room) -> float:
        """Return the coordinate of the wall's face."""
        return (room.low if self.inward > 0 else room.high)[self.axis]

    def span(self, room: Room) -> tuple[float, float]:
        """Return where the wall starts and ends along its own direction."""
        return room.low[1 - self.axis], room.high[1 - self.axis]


SIDES = (
    Side("south", 1, 1, 0.0),
    Side("north", 1, -1, np.pi),
    Side("west", 0, 1, -np.pi / 2),
    Side("east", 0, -1, np.pi / 2),
)
"""The walls of every room, in this order."""


def openings(layout: Layout, room: int, side: Side) -> list[Doorway]:
    """Return the doorways in one wall of a room, in order along it."""
    plane = side.plane(layout.rooms[room])
    found = [
        way
        for way in layout.doorways
        if way.axis == side.axis and room in (way.below, way.above) and abs(way.at - plane) < WALL_M
    ]
    return sorted(found, key=lambda way: way.low)


def structure(layout: Layout, rng: np.random.Generator) -> list[tuple[Model, int]]:
    """Return, room by room, its floor, its ceiling and its four walls (in the order of SIDES), in world coordinates."""
    models = []
    for number, room in enumerate(layout.rooms):
        floor, floor_color = _floor_paint(room, rng)
        models.append((Model("floor", floor_color, _floor(layout, number, floor), contact="none"), number))
        ceiling = Paint((0.95, 0.95, 0.94), Texture.PLAIN, 1.5, 0.02, 0.0)
        models.append((Model("ceiling", "white", _ceiling(room, ceiling), contact="none"), number))
        paint, color = _wall_paint(room, rng)
        accent = int(rng.integers(4)) if room.kind not in ("bathroom", "kitchen") and rng.random() < 0.5 else -1
        accent_color = pick(rng, "blue", "green", "yellow", "orange", "gray", "pink")
        base = Paint(mix(pick(rng, "white", "white", "brown", "gray"), rng, 0.01))
        for k, side in enumerate(SIDES):
            accented = k == accent
            face = Paint(_muted(accent_color), Texture.PLAIN, 0.8, 0.03, 0.01) if accented else paint
            shape = _wall(layout, number, side, face, base)
            models.append((Model("wall", accent_color if accented else color, shape, contact="none"), number))
    return models


def _muted(color: str) -> RGB:
    r, g, b = (0.86 * c + 0.14 * 0.9 for c in PALETTE[color])
    return (r, g, b)


def _floor_paint(room: Room, rng: np.random.Generator) -> tuple[Paint, str]:
    if room.kind in ("bathroom", "kitchen", "laundry room"):
        color = pick(rng, "white", "gray", "gray")
        return Paint(mix(color, rng, 0.01), Texture.TILES, 0.4, 0.16, 0.05), color
    if rng.random() < 0.75:
        tone = float(rng.uniform(0.9, 1.25))
        r, g, b = (min(1.0, tone * c) for c in PALETTE["brown"])
        return Paint((r, g, b), Texture.PLANKS, 0.16, 0.16, 0.05), "brown"
    color = pick(rng, "gray", "white")
    return Paint(mix(color, rng, 0.01), Texture.FABRIC, 0.3, 0.08, 0.0), color


def _wall_paint(room: Room, rng: np.random.Generator) -> tuple[Paint, str]:
    if room.kind == "bathroom":
        return Paint((0.90, 0.93, 0.95), Texture.TILES, 0.2, 0.12, 0.06), "white"
    tints: tuple[RGB, ...] = ((0.93, 0.92, 0.89), (0.90, 0.91, 0.93), (0.92, 0.93, 0.90))
    return Paint(tints[int(rng.integers(len(tints)))], Texture.PLAIN, 0.9, 0.025, 0.01), "white"


def _upright(axis: int, plane: float, start: float, stop: float, z0: float, z1: float) -> Float[np.ndarray, "4 3"]:
    """Corners of an upright rectangle; its normal is +x (axis 0) or -y (axis 1) when start < stop."""
    corners = np.empty((4, 3))
    corners[:, axis] = plane
    corners[:, 1 - axis] = (start, stop, start, stop)
    corners[:, 2] = (z0, z0, z1, z1)
    return corners


def _face(shape: Shape, side: Side, plane: float, low: float, high: float, z0: float, z1: float, paint: Paint) -> None:
    forward = (side.axis == 0) == (side.inward > 0)
    start, stop = (low, high) if forward else (high, low)
    shape.quad(_upright(side.axis, plane, start, stop, z0, z1), paint)


def _wall(layout: Layout, number: int, side: Side, paint: Paint, base: Paint) -> Shape:
    room, shape = layout.rooms[number], Shape()
    plane, (low, high) = side.plane(room), side.span(room)
    outer = plane - side.inward * WALL_M / 2
    thickness, rise = BASEBOARD_M
    ways = openings(layout, number, side)
    for way in ways:
        _reveal(shape, side, plane, outer, way, paint)
    forward = (side.axis == 0) == (side.inward > 0)
    for start, stop, detail in _columns(low - SEAL_M, high + SEAL_M, ways):
        ends = (start > low, stop < high, False, False)
        pieces = [((start, -SEAL_M, stop, room.height + SEAL_M), ends)]
        for way in ways:
            opening = (way.low, -1.0, way.high, DOOR_HEIGHT_M)
            pieces = [part for piece in pieces for part in rectangle_without(*piece, opening)]
        for (left, z0, right, z1), joins in pieces:
            along, turned = ((left, right), joins) if forward else ((right, left), (joins[1], joins[0], *joins[2:]))
            shape.add(Kind.QUAD, _upright(side.axis, plane, *along, z0, z1), paint, joins=turned, detail=detail)
    at = low
    for end, resume in [*((way.low, way.high) for way in ways), (high, high)]:
        _face(shape, side, plane + side.inward * thickness, at, end, 0.0, rise, base)
        strip = np.empty((4, 3))
        strip[:, 1 - side.axis] = (at, end, at, end)
        strip[:, side.axis] = np.array([0, 0, 1, 1]) * side.inward * thickness + plane
        strip[:, 2] = rise
        upward = (side.axis == 1) == (side.inward > 0)
        shape.quad(strip if upward else strip[[1, 0, 3, 2]], base)
        at = resume
    return shape


def _columns(low: float, high: float, ways: list[Doorway]) -> list[tuple[float, float, float]]:
    """Start, end and detail of the upright strips of a wall: finer about doorways, where people come close."""
    spans = [(max(low, way.low - DOORSIDE_M), min(high, way.high + DOORSIDE_M)) for way in ways]
    columns, at = [], low
    for start, stop in spans:
        if start > at + 0.05:
            columns.append((at, start, 1.0))
            at = start
        if stop > at:
            columns.append((at, stop, DOORSIDE_DETAIL))
            at = stop
    if high > at:
        columns.append((at, high, 1.0))
    return columns


def _reveal(shape: Shape, side: Side, plane: float, outer: float, way: Doorway, paint: Paint) -> None:
    """The cut through the wall around a doorway, to the wall's middle."""
    near, far = sorted((plane, outer))
    for along, facing in ((way.low, 1), (way.high, -1)):
        start, stop = (near, far) if (side.axis == 1) == (facing > 0) else (far, near)
        face = _upright(1 - side.axis, along, start, stop, 0.0, DOOR_HEIGHT_M)
        shape.add(Kind.QUAD, face, paint, detail=DOORSIDE_DETAIL)
    lintel = np.empty((4, 3))
    lintel[:, side.axis] = (near, near, far, far) if side.axis == 0 else (far, far, near, near)
    lintel[:, 1 - side.axis] = (way.low, way.high, way.low, way.high)
    lintel[:, 2] = DOOR_HEIGHT_M
    shape.add(Kind.QUAD, lintel, paint, detail=DOORSIDE_DETAIL)


def _flat(low: tuple[float, float], high: tuple[float, float], z: float) -> Float[np.ndarray, "4 3"]:
    """Corners of a level rectangle that faces up."""
    return np.array([(low[0], low[1], z), (high[0], low[1], z), (low[0], high[1], z), (high[0], high[1], z)])


def _floor(layout: Layout, number: int, paint: Paint) -> Shape:
    """Floor of the room and of its half of every doorway."""
    room, shape = layout.rooms[number], Shape()
    shape.quad(_flat(_shifted(room.low, -SEAL_M), _shifted(room.high, SEAL_M), 0.0), paint)
    for side in SIDES:
        plane = side.plane(room)
        outer = plane - side.inward * WALL_M / 2
        for way in openings(layout, number, side):
            low, high = [way.low - SEAL_M, way.low - SEAL_M], [way.high + SEAL_M, way.high + SEAL_M]
            low[side.axis], high[side.axis] = sorted((plane + side.inward * SEAL_M, outer))
            shape.quad(_flat((low[0], low[1]), (high[0], high[1]), 0.0), paint)
    return shape


def _ceiling(room: Room, paint: Paint) -> Shape:
    shape = Shape()
    shape.quad(_flat(_shifted(room.low, -SEAL_M), _shifted(room.high, SEAL_M), room.height)[[1, 0, 3, 2]], paint)
    return shape


def _shifted(corner: XY, by: float) -> XY:
    return corner[0] + by, corner[1] + by
