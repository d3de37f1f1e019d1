"""Everything placed so far, and the free space of one room: what may still be put where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from pipeline.scene.objects import Relation
from pipeline.scene.procedural.floor_grid import FURNISHED_M, FloorGrid
from pipeline.scene.procedural.layout import DOOR_WIDTH_M, Doorway, Layout, Room
from pipeline.scene.procedural.things import Model, Mount, Placed, oriented_boxes_overlap
from pipeline.scene.procedural.walls import Side

GAP_M = 0.02
"""Least distance between things that stand side by side."""
LANDING_M = 0.85
"""Floor kept free on either side of a doorway."""
HEAD_M = 1.9
"""Things hung higher than this never stand in anybody's way."""

Rect = tuple[float, float, float, float]


@dataclass(slots=True)
class Home:
    """Everything placed so far, over all rooms."""

    layout: Layout
    """Floor plan."""
    things: list[Placed] = field(default_factory=list)
    """Placed things; a thing's instance is its index."""
    by_room: dict[int, list[Placed]] = field(default_factory=dict)
    """What may be bumped into in each room; floors, ceilings and walls are not listed."""

    def add(
        self,
        model: Model,
        at: Sequence[float],
        yaw: float,
        room: int,
        *,
        parent: int = -1,
        relation: Relation = "",
        host: int = -1,
        mount: Mount = "base",
    ) -> Placed:
        """Place a thing for good and return it."""
        placed = Placed(
            model, np.array(at, np.float64), yaw, room, len(self.things), parent, relation, host=host, mount=mount
        )
        self.things.append(placed)
        return placed


class RoomSpace:
    """The free space of one room: checks places, and keeps what is put there."""

    def __init__(self, home: Home, number: int, surfaces: dict[str, int], rng: np.random.Generator) -> None:
        self.home, self.number, self.rng = home, number, rng
        self.room: Room = home.layout.rooms[number]
        self.surfaces = surfaces
        self.doorways = [way for way in home.layout.doorways if number in (way.below, way.above)]
        self._landings = [self._landing(way) for way in self.doorways]
        self._grid = FloorGrid.of_room(self.room, body_m=FURNISHED_M)
        self._boxes = np.zeros((0, 2, 3))
        self._doors = [self._inside(way, 0.5) for way in self.doorways]

    def collides(self, placed: Placed, gap: float = GAP_M) -> bool:
        """Return whether a thing comes too close to anything but its own ancestors."""
        ancestors = set()
        parent = placed.parent
        while parent >= 0:
            ancestors.add(parent)
            parent = self.home.things[parent].parent
        box = placed.box
        near = (box[0] < self._boxes[:, 1] + gap).all(axis=1) & (self._boxes[:, 0] < box[1] + gap).all(axis=1)
        others = self.home.by_room.get(self.number, [])
        return any(
            others[i].instance not in ancestors and oriented_boxes_overlap(placed, others[i], gap)
            for i in np.flatnonzero(near)
        )

    def leaves_way(self, placed: Placed, others: Sequence[Placed] = ()) -> bool:
        """Return whether people still get to every doorway with a thing, and others, added."""
        return self._grid.stays_open([*others, placed], self._doors)

    def clear_of_doorways(self, placed: Placed, own: Doorway) -> bool:
        """Return whether a thing leaves the floor before every doorway but its own free, and touches nothing."""
        box = placed.box
        for way, (x0, y0, x1, y1) in zip(self.doorways, self._landings, strict=True):
            if way is not own and box[0, 0] < x1 and x0 < box[1, 0] and box[0, 1] < y1 and y0 < box[1, 1]:
                return False
        return self.within(placed, 0.0) and not self.collides(placed)

    def new(self, model: Model, at: Float[np.ndarray, "3"], yaw: float, parent: int = -1) -> Placed:
        """Return a thing standing on this room's floor, not yet added."""
        return Placed(model, np.array(at, np.float64), float(yaw), self.number, -1, parent, host=self.surfaces["floor"])

    def against(
        self, model: Model, side: Side, middle: float, gap: float, offset: float | None = None
    ) -> Placed | None:
        """Return a thing with its back to a wall, or None where it would reach out of the room.

        Args:
            model: The thing.
            side: The wall.
            middle: Where along the wall the middle of its box is, world coordinate, metres.
            gap: Distance from wall to back, metres.
            offset: The x in its own frame taken for the middle; None for its box's.
        """
        placed = self.new(model, np.zeros(3), side.yaw)
        local = np.array([model.bounds[:, 0].mean() if offset is None else offset, model.bounds[0][1], 0.0])
        target = np.zeros(3)
        target[side.axis] = side.plane(self.room) + side.inward * gap
        target[1 - side.axis] = middle
        placed.at = target - (placed.to_world(local) - placed.at)
        placed.at[2] = 0.0
        return placed if self.within(placed, -0.001) else None

    def within(self, placed: Placed, margin: float) -> bool:
        """Return whether a thing keeps `margin` metres from all walls."""
        return all(self.room.contains(float(x), float(y), margin) for x, y in placed.footprint)

    def wall_distance(self, corner: Float[np.ndarray, "2"]) -> float:
        """Return the distance of a floor point from the nearest wall, metres."""
        low, high = np.array(self.room.low), np.array(self.room.high)
        return float(min((corner - low).min(), (high - corner).min()))

    def fits(
        self,
        placed: Placed,
        *,
        front: float = 0.0,
        others: Sequence[Placed] = (),
        gap: float = GAP_M,
        walk: bool = True,
        landings: bool = True,
    ) -> bool:
        """Return whether a thing may stand where it is.

        Args:
            placed: The thing.
            front: Free floor wanted before it, metres; 0 for none.
            others: Further things that will be added together with it.
            gap: Least distance from other things, metres.
            walk: Whether to make sure that people still get to every doorway.
            landings: Whether to keep the floor before doorways free.
        """
        if not self.within(placed, -0.001) or self.collides(placed, gap):
            return False
        if any(oriented_boxes_overlap(placed, other, 0.001) for other in others):
            return False
        box = placed.box
        if box[0, 2] < HEAD_M and landings:
            for x0, y0, x1, y1 in self._landings:
                if box[0, 0] < x1 and x0 < box[1, 0] and box[0, 1] < y1 and y0 < box[1, 1]:
                    return False
        if front and self._front_blocked(placed, front):
            return False
        return not walk or self.leaves_way(placed, others)

    def _front_blocked(self, placed: Placed, front: float) -> bool:
        """Whether the floor before a thing is taken, or is outside the room."""
        low, high = placed.model.bounds
        points = [(x, high[1] + front, 0.0) for x in (low[0] * 0.7, 0.0, high[0] * 0.7)]
        low_x, low_y, low_z = self._boxes[:, 0].T
        high_x, high_y, high_z = self._boxes[:, 1].T
        standing = (high_z > 0.05) & (low_z < 0.6)
        for x, y, _ in placed.to_world(np.array(points)):
            taken = standing & (low_x < x) & (x < high_x) & (low_y < y) & (y < high_y)
            if taken.any() or not self.room.contains(float(x), float(y)):
                return True
        return False

    def keep(self, placed: Placed) -> Placed:
        """Add a placed thing that the caller has checked, and return it."""
        placed.instance = len(self.home.things)
        self.home.things.append(placed)
        self.home.by_room.setdefault(self.number, []).append(placed)
        self._boxes = np.concatenate([self._boxes, placed.box[None]])
        self._grid.block(placed)
        return placed

    def _inside(self, way: Doorway, depth: float) -> tuple[float, float]:
        """A floor point before a doorway."""
        x, y = way.center
        step = depth if self.room.center[way.axis] > way.at else -depth
        return (x + step, y) if way.axis == 0 else (x, y + step)

    def _landing(self, way: Doorway) -> Rect:
        x, y = self._inside(way, LANDING_M / 2 + 0.06)
        half = (LANDING_M / 2, DOOR_WIDTH_M / 2 + 0.03)
        hx, hy = half if way.axis == 0 else half[::-1]
        return (x - hx, y - hy, x + hx, y + hy)
