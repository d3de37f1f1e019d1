"""Putting things into a room without overlap, and without walling anyone in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.scene.objects import Relation
from pipeline.scene.procedural.floor_grid import FloorGrid
from pipeline.scene.procedural.layout import DOOR_WIDTH_M, Doorway, Layout, Room
from pipeline.scene.procedural.things import Model, Mount, Placed, oriented_boxes_overlap
from pipeline.scene.procedural.walls import SIDES, Side

TRIES = 24
"""Random positions tried before a thing is left out."""
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


class RoomPlacer:
    """Finds places in one room.

    Every method returns the placed thing, or None when no free place was found: rooms differ, and a
    sofa less is better than one inside a wall.
    """

    def __init__(self, home: Home, number: int, surfaces: dict[str, int], rng: np.random.Generator) -> None:
        self.home, self.number, self.rng = home, number, rng
        self.room: Room = home.layout.rooms[number]
        self.surfaces = surfaces
        self.doorways = [way for way in home.layout.doorways if number in (way.below, way.above)]
        self._landings = [self._landing(way) for way in self.doorways]
        self._grid = FloorGrid.of_room(self.room)
        self._boxes = np.zeros((0, 2, 3))
        self._doors = [self._inside(way, 0.5) for way in self.doorways]

    def against_wall(
        self,
        model: Model,
        *,
        gap: float = 0.03,
        sides: Sequence[Side] = SIDES,
        corner: bool = False,
        front: float = 0.35,
    ) -> Placed | None:
        """Stand a thing with its back to a wall.

        Args:
            model: The thing.
            gap: Distance from wall to back, metres.
            sides: Walls to try, tried in random order.
            corner: Whether to stand it in a corner.
            front: Free floor wanted before it, metres.
        """
        for k in range(TRIES):
            side = sides[int(self.rng.integers(len(sides)))]
            start, stop = side.span(self.room)
            margin = 0.04 + (0.0 if corner else float(self.rng.uniform(0.0, 0.5)) * (k < TRIES // 2))
            first, last = start + model.size[0] / 2 + margin, stop - model.size[0] / 2 - margin
            if first > last:
                continue
            middle = (first, last)[int(self.rng.integers(2))] if corner else float(self.rng.uniform(first, last))
            placed = self._against(model, side, middle, gap)
            if placed and self._fits(placed, front=front):
                return self._keep(placed)
        return None

    def run(self, models: Sequence[Model], sides: Sequence[Side] = SIDES) -> list[Placed]:
        """Stand things side by side along a wall, as kitchens do; return those that found room on the best wall."""
        best: list[Placed] = []
        for side in self.rng.permutation(np.array(range(len(sides)))):
            start, stop = sides[side].span(self.room)
            row: list[Placed] = []
            at = start + 0.03
            for model in models:
                while at + model.size[0] + 0.03 <= stop:
                    offset = float(model.bounds[:, 0].mean())
                    placed = self._against(model, sides[side], at + model.size[0] / 2, 0.02, offset)
                    at += 0.1
                    if placed and self._fits(placed, others=row, gap=0.005):
                        row.append(placed)
                        at += model.size[0] - 0.1 + 0.012
                        break
            if len(row) > len(best):
                best = row
        return [self._keep(placed) for placed in best if self._fits(placed, gap=0.005)]

    def beside(self, anchor: Placed, model: Model, *, gap: float = 0.08, align_back: bool = True) -> Placed | None:
        """Stand a thing to the left or right of another, backs aligned."""
        low, high = anchor.model.bounds
        for side in self.rng.permutation([-1, 1]):
            edge = high[0] if side > 0 else low[0]
            own = model.bounds[0][0] if side > 0 else model.bounds[1][0]
            y = low[1] - model.bounds[0][1] if align_back else (low[1] + high[1]) / 2
            at = anchor.to_world(np.array([edge + side * gap - own, y, 0.0]))
            placed = self._new(model, at, anchor.yaw)
            if self._fits(placed):
                return self._keep(placed)
        return None

    def in_front(self, anchor: Placed, model: Model, *, gap: float, facing: bool = False) -> Placed | None:
        """Stand a thing before another, at a distance; facing it or looking the same way."""
        low, high = anchor.model.bounds
        for k in range(8):
            x = (low[0] + high[0]) / 2 + float(self.rng.uniform(-0.1, 0.1)) * k
            distance = gap + 0.06 * k
            reach = model.bounds[1][1] if facing else -model.bounds[0][1]
            at = anchor.to_world(np.array([x, high[1] + distance + reach, 0.0]))
            turn = np.pi if facing else 0.0
            placed = self._new(model, at, anchor.yaw + turn + float(self.rng.uniform(-0.06, 0.06)) * facing)
            if self._fits(placed):
                return self._keep(placed)
        return None

    def around(self, table: Placed, build: Callable[[], Model], count: int, *, gap: float = 0.06) -> list[Placed]:
        """Stand chairs around a table, facing it."""
        low, high = table.model.bounds
        half = (high - low) / 2
        seats = [(0.0, 0.25), (0.0, -0.25), (np.pi, 0.25), (np.pi, -0.25), (np.pi / 2, 0.0), (-np.pi / 2, 0.0)]
        chairs: list[Placed] = []
        for index in self.rng.permutation(len(seats)):
            if len(chairs) == count:
                break
            turn, share = seats[int(index)]
            model = build()
            across, along = (half[1], half[0]) if abs(np.cos(turn)) > 0.5 else (half[0], half[1])
            distance = across + gap + float(self.rng.uniform(0.0, 0.08)) + model.bounds[1][1]
            c, s = np.cos(turn), np.sin(turn)
            x, y = share * 2 * along, -distance
            at = table.to_world(np.array([c * x - s * y, s * x + c * y, 0.0]))
            placed = self._new(model, at, table.yaw + turn + float(self.rng.uniform(-0.12, 0.12)))
            if self._fits(placed):
                chairs.append(self._keep(placed))
        return chairs

    def anywhere(self, model: Model, *, edge: bool = True) -> Placed | None:
        """Stand a thing on free floor, near a wall or, without `edge`, towards the middle, turned a little."""
        radius = float(np.hypot(*model.size[:2]) / 2)
        for _ in range(TRIES):
            if edge:
                side = SIDES[int(self.rng.integers(4))]
                start, stop = side.span(self.room)
                if stop - start < 2 * radius + 0.1:
                    continue
                middle = float(self.rng.uniform(start + radius + 0.03, stop - radius - 0.03))
                placed = self._against(model, side, middle, float(self.rng.uniform(0.03, 0.25)))
                if placed is None:
                    continue
                placed.yaw += float(self.rng.uniform(-0.12, 0.12))
            else:
                low, high = np.array(self.room.low) + radius + 0.4, np.array(self.room.high) - radius - 0.4
                if (low > high).any():
                    return None
                placed = self._new(
                    model, np.array([*self.rng.uniform(low, high), 0.0]), float(self.rng.uniform(-3.1, 3.1))
                )
            if self._fits(placed):
                return self._keep(placed)
        return None

    def behind_door(self, door: Placed, model: Model) -> Placed | None:
        """Stand a thing between an open door and the wall beside it."""
        low, high = door.model.bounds
        width = float(high[0] - low[0])
        for side in (-1, 1):
            for k in range(6):
                x = width * float(self.rng.uniform(0.35, 0.75))
                at = door.to_world(np.array([x, side * (0.06 + 0.03 * k - float(model.bounds[0][1])), 0.0]))
                placed = self._new(model, at, door.yaw + (0.0 if side > 0 else np.pi), parent=door.instance)
                placed.relation = "behind"
                beside_wall = min(self._wall_distance(c) for c in placed.footprint) < 0.45
                if beside_wall and self._fits(placed, landings=False):
                    return self._keep(placed)
        return None

    def on_wall(
        self, model: Model, *, bottom: tuple[float, float], sides: Sequence[Side] = SIDES, above: Placed | None = None
    ) -> Placed | None:
        """Hang a thing on a wall, its lowest point between two heights; over `above` when given."""
        if above is not None:
            sides = [side for side in sides if abs(np.cos(side.yaw - above.yaw) - 1) < 0.01] or sides
        for _ in range(TRIES):
            side = sides[int(self.rng.integers(len(sides)))]
            start, stop = side.span(self.room)
            half = model.size[0] / 2 + 0.06
            if stop - start < 2 * half:
                continue
            middle = float(self.rng.uniform(start + half, stop - half))
            if above is not None:
                middle = float(above.box[:, 1 - side.axis].mean() + self.rng.uniform(-0.05, 0.05))
                middle = float(np.clip(middle, start + half, stop - half))
            z = float(self.rng.uniform(*bottom)) - float(model.bounds[0][2])
            placed = self._against(model, side, middle, 0.0)
            if placed is None:
                continue
            placed.at[2] = z
            wall = self.surfaces[side.name]
            placed.parent, placed.relation, placed.host, placed.mount = wall, "on", wall, "back"
            top = placed.box[1, 2]
            if top < self.room.height - 0.02 and self._fits(placed, walk=bool(placed.box[0, 2] < HEAD_M)):
                return self._keep(placed)
        return None

    def at_wall(
        self, model: Model, side: Side, anchor: Placed | None, along: float, *, height: float | None = None
    ) -> Placed | None:
        """Put a thing to a wall at an exact place.

        Args:
            model: The thing.
            side: The wall.
            anchor: Thing on that wall that `along` is measured from; None measures from the world's origin.
            along: Distance along the wall, metres.
            height: Height of its lowest point when it hangs there; None for what stands on the floor.
        """
        if anchor is not None:
            along += float(anchor.box[:, 1 - side.axis].mean())
        placed = self._against(model, side, along, 0.0)
        if placed is None:
            return None
        if height is not None:
            wall = self.surfaces[side.name]
            placed.at[2] = height - float(model.bounds[0][2])
            placed.parent, placed.relation, placed.host, placed.mount = wall, "on", wall, "back"
        return self._keep(placed) if self._fits(placed, gap=0.005) else None

    def under_ceiling(self, model: Model) -> Placed | None:
        """Hang a thing from the middle of the ceiling."""
        ceiling = self.surfaces["ceiling"]
        at = np.array([*self.room.center, self.room.height])
        placed = self._new(model, at, 0.0, parent=ceiling)
        placed.relation, placed.host, placed.mount = "on", ceiling, "top"
        return self._keep(placed) if self._fits(placed, walk=False) else None

    def lay(self, model: Model, near: Placed | None = None, *, distance: float = 0.5) -> Placed | None:
        """Lay a mat before something or in the middle of the room, on free floor."""
        for _ in range(8):
            if near is None:
                spread = 0.15 * (np.array(self.room.high) - self.room.low)
                at = np.array([*(np.array(self.room.center) + self.rng.uniform(-spread, spread)), 0.0])
                placed = self._new(model, at, float(self.rng.choice([0.0, np.pi / 2])))
            else:
                y = float(near.model.bounds[1][1]) + distance + model.size[1] / 2
                placed = self._new(model, near.to_world(np.array([0.0, y, 0.0])), near.yaw)
            if self._within(placed, 0.03) and not self.collides(placed, 0.01):
                return self._keep(placed)
        return None

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

    def clear_of_doorways(self, placed: Placed, own: Doorway) -> bool:
        """Return whether a thing leaves the floor before every doorway but its own free, and touches nothing."""
        box = placed.box
        for way, (x0, y0, x1, y1) in zip(self.doorways, self._landings, strict=True):
            if way is not own and box[0, 0] < x1 and x0 < box[1, 0] and box[0, 1] < y1 and y0 < box[1, 1]:
                return False
        return self._within(placed, 0.0) and not self.collides(placed)

    def keep(self, placed: Placed) -> Placed:
        """Add a placed thing that the caller has checked."""
        return self._keep(placed)

    def _new(self, model: Model, at: np.ndarray, yaw: float, parent: int = -1) -> Placed:
        return Placed(model, np.array(at, np.float64), float(yaw), self.number, -1, parent, host=self.surfaces["floor"])

    def _against(
        self, model: Model, side: Side, middle: float, gap: float, offset: float | None = None
    ) -> Placed | None:
        """Back to a wall, its box's middle at `middle` along it."""
        placed = self._new(model, np.zeros(3), side.yaw)
        local = np.array([model.bounds[:, 0].mean() if offset is None else offset, model.bounds[0][1], 0.0])
        target = np.zeros(3)
        target[side.axis] = side.plane(self.room) + side.inward * gap
        target[1 - side.axis] = middle
        placed.at = target - (placed.to_world(local) - placed.at)
        placed.at[2] = 0.0
        return placed if self._within(placed, -0.001) else None

    def _within(self, placed: Placed, margin: float) -> bool:
        return all(self.room.contains(float(x), float(y), margin) for x, y in placed.footprint)

    def _wall_distance(self, corner: np.ndarray) -> float:
        low, high = np.array(self.room.low), np.array(self.room.high)
        return float(min((corner - low).min(), (high - corner).min()))

    def _fits(
        self,
        placed: Placed,
        *,
        front: float = 0.0,
        others: Sequence[Placed] = (),
        gap: float = GAP_M,
        walk: bool = True,
        landings: bool = True,
    ) -> bool:
        if not self._within(placed, -0.001) or self.collides(placed, gap):
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
        return not walk or self._grid.stays_open([*others, placed], self._doors)

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

    def _keep(self, placed: Placed) -> Placed:
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
