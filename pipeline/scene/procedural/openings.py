"""Door leaves, windows with curtains, and what hangs beside them: placed before any furniture."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.fixtures import curtain, door, light_switch, radiator, window
from pipeline.scene.procedural.home import Home
from pipeline.scene.procedural.layout import DOOR_HEIGHT_M, DOOR_WIDTH_M, WALL_M, Doorway, Room
from pipeline.scene.procedural.paint import pick
from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.things import Model, Placed
from pipeline.scene.procedural.walls import SIDES, Side

DOOR_COLORS = ("white", "white", "brown", "brown", "gray", "blue", "red", "green")


def hang_doors(home: Home, placers: list[RoomPlacer], rng: np.random.Generator) -> None:
    """Hang a leaf in every doorway that has one: shut between its jambs, or swung into one of its rooms.

    A leaf that would stand before another doorway whichever way it is swung is left out.
    """
    for way in home.layout.doorways:
        if not way.door:
            continue
        color = pick(rng, *DOOR_COLORS)
        leaf = door(rng, DOOR_WIDTH_M - 0.03, DOOR_HEIGHT_M - 0.02, is_open=way.door == "open", color=color)
        owners = [int(room) for room in rng.permutation([room for room in (way.below, way.above) if room >= 0])]
        if way.door == "closed":
            at = np.zeros(3)
            at[way.axis], at[1 - way.axis] = way.at, way.low + 0.015
            placer = placers[owners[0]]
            yaw = 0.0 if way.axis == 1 else np.pi / 2
            placer.keep(Placed(leaf, at, yaw, owners[0], -1, host=placer.surfaces["floor"]))
            continue
        for placer in (placers[room] for room in owners):
            swung = [_swung(way, placer, leaf, near_low, rng) for near_low in _ends(way, placer.room)]
            clear = [leaf for leaf in swung if placer.clear_of_doorways(leaf, way)]
            if clear:
                placer.keep(clear[0])
                break


def _ends(way: Doorway, room: Room) -> tuple[bool, bool]:
    """Whether the hinge is at the low end, first for the end nearer to a side wall."""
    along = 1 - way.axis
    near_low = bool(way.low - room.low[along] < room.high[along] - way.high)
    return near_low, not near_low


def _swung(way: Doorway, placer: RoomPlacer, leaf: Model, near_low: bool, rng: np.random.Generator) -> Placed:
    """An open leaf, hinged at one end of the opening, standing beside it and leaning a little away."""
    room, along = placer.room, 1 - way.axis
    inward = 1.0 if room.center[way.axis] > way.at else -1.0
    outward = -1.0 if near_low else 1.0
    at = np.zeros(3)
    at[way.axis] = way.at + inward * (WALL_M / 2 + 0.05)
    at[along] = (way.low if near_low else way.high) + outward * 0.05
    lean = float(rng.uniform(0.0, 0.12)) * outward
    direction = np.zeros(2)
    direction[way.axis], direction[along] = inward * np.cos(lean), np.sin(lean)
    yaw = float(np.arctan2(direction[1], direction[0]))
    return Placed(leaf, at, yaw, placer.number, -1, host=placer.surfaces["floor"])


def open_windows(placer: RoomPlacer) -> None:
    """Set one or two windows into the outside walls, some with curtains or a radiator beneath."""
    rng = placer.rng
    outside = [side for side in SIDES if _is_outside(placer, side)]
    for _ in range(2 if placer.room.area > 14 else 1):
        if not outside:
            break
        placed = placer.on_wall(window(rng), bottom=(0.92, 1.0), sides=outside)
        if placed is None:
            continue
        side = next(side for side in SIDES if abs(side.yaw - placed.yaw) < 0.01)
        outside.remove(side)
        if placer.room.kind not in ("kitchen", "bathroom") and rng.random() < 0.7:
            drape = curtain(rng)
            for end in (-1, 1):
                placer.at_wall(drape, side, placed, end * (placed.model.size[0] / 2 + 0.24))
        if rng.random() < 0.5:
            placer.at_wall(radiator(rng), side, placed, 0.0)


def add_switches(placer: RoomPlacer) -> None:
    """A light switch beside the first doorway."""
    for way in placer.doorways[:1]:
        side = next(side for side in SIDES if side.axis == way.axis and abs(side.plane(placer.room) - way.at) < WALL_M)
        for middle in (way.low - 0.2, way.high + 0.2):
            if placer.at_wall(light_switch(placer.rng), side, None, middle, height=1.1):
                break


def _is_outside(placer: RoomPlacer, side: Side) -> bool:
    """Whether no other room lies beyond a wall."""
    plane = side.plane(placer.room)
    for other in placer.home.layout.rooms:
        facing = other.high[side.axis] if side.inward > 0 else other.low[side.axis]
        if abs(facing - (plane - side.inward * WALL_M)) < 0.05:
            return False
    return True
