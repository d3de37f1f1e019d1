"""Ways to put things into a room: against walls, around tables, on walls, without overlap or walling anyone in."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.scene.procedural.home import HEAD_M, RoomSpace
from pipeline.scene.procedural.things import Model, Placed
from pipeline.scene.procedural.walls import SIDES, Side

TRIES = 24
"""Random positions tried before a thing is left out."""


class RoomPlacer(RoomSpace):
    """Finds places in one room.

    Every method returns the placed thing, or None when no free place was found: rooms differ, and a
    sofa less is better than one inside a wall.
    """

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
            placed = self.against(model, side, middle, gap)
            if placed and self.fits(placed, front=front):
                return self.keep(placed)
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
                    placed = self.against(model, sides[side], at + model.size[0] / 2, 0.02, offset)
                    at += 0.1
                    if placed and self.fits(placed, others=row, gap=0.005):
                        row.append(placed)
                        at += model.size[0] - 0.1 + 0.012
                        break
            if len(row) > len(best):
                best = row
        return [self.keep(placed) for placed in best if self.fits(placed, gap=0.005)]

    def beside(self, anchor: Placed, model: Model, *, gap: float = 0.08, align_back: bool = True) -> Placed | None:
        """Stand a thing to the left or right of another, backs aligned."""
        low, high = anchor.model.bounds
        for side in self.rng.permutation([-1, 1]):
            edge = high[0] if side > 0 else low[0]
            own = model.bounds[0][0] if side > 0 else model.bounds[1][0]
            y = low[1] - model.bounds[0][1] if align_back else (low[1] + high[1]) / 2
            at = anchor.to_world(np.array([edge + side * gap - own, y, 0.0]))
            placed = self.new(model, at, anchor.yaw)
            if self.fits(placed):
                return self.keep(placed)
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
            placed = self.new(model, at, anchor.yaw + turn + float(self.rng.uniform(-0.06, 0.06)) * facing)
            if self.fits(placed):
                return self.keep(placed)
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
            placed = self.new(model, at, table.yaw + turn + float(self.rng.uniform(-0.12, 0.12)))
            if self.fits(placed):
                chairs.append(self.keep(placed))
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
                placed = self.against(model, side, middle, float(self.rng.uniform(0.03, 0.25)))
                if placed is None:
                    continue
                placed.yaw += float(self.rng.uniform(-0.12, 0.12))
            else:
                low, high = np.array(self.room.low) + radius + 0.4, np.array(self.room.high) - radius - 0.4
                if (low > high).any():
                    return None
                placed = self.new(
                    model, np.array([*self.rng.uniform(low, high), 0.0]), float(self.rng.uniform(-3.1, 3.1))
                )
            if self.fits(placed):
                return self.keep(placed)
        return None

    def behind_door(self, door: Placed, model: Model) -> Placed | None:
        """Stand a thing between an open door and the wall beside it."""
        low, high = door.model.bounds
        width = float(high[0] - low[0])
        for side in (-1, 1):
            for k in range(6):
                x = width * float(self.rng.uniform(0.35, 0.75))
                at = door.to_world(np.array([x, side * (0.06 + 0.03 * k - float(model.bounds[0][1])), 0.0]))
                placed = self.new(model, at, door.yaw + (0.0 if side > 0 else np.pi), parent=door.instance)
                placed.relation = "behind"
                beside_wall = min(self.wall_distance(c) for c in placed.footprint) < 0.45
                if beside_wall and self.fits(placed, landings=False):
                    return self.keep(placed)
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
            placed = self.against(model, side, middle, 0.0)
            if placed is None:
                continue
            placed.at[2] = z
            wall = self.surfaces[side.name]
            placed.parent, placed.relation, placed.host, placed.mount = wall, "on", wall, "back"
            top = placed.box[1, 2]
            if top < self.room.height - 0.02 and self.fits(placed, walk=bool(placed.box[0, 2] < HEAD_M)):
                return self.keep(placed)
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
        placed = self.against(model, side, along, 0.0)
        if placed is None:
            return None
        if height is not None:
            wall = self.surfaces[side.name]
            placed.at[2] = height - float(model.bounds[0][2])
            placed.parent, placed.relation, placed.host, placed.mount = wall, "on", wall, "back"
        return self.keep(placed) if self.fits(placed, gap=0.005) else None

    def under_ceiling(self, model: Model) -> Placed | None:
        """Hang a thing from the middle of the ceiling."""
        ceiling = self.surfaces["ceiling"]
        at = np.array([*self.room.center, self.room.height])
        placed = self.new(model, at, 0.0, parent=ceiling)
        placed.relation, placed.host, placed.mount = "on", ceiling, "top"
        return self.keep(placed) if self.fits(placed, walk=False) else None

    def lay(self, model: Model, near: Placed | None = None, *, distance: float = 0.5) -> Placed | None:
        """Lay a mat before something or in the middle of the room, on free floor."""
        for _ in range(8):
            if near is None:
                spread = 0.15 * (np.array(self.room.high) - self.room.low)
                at = np.array([*(np.array(self.room.center) + self.rng.uniform(-spread, spread)), 0.0])
                placed = self.new(model, at, float(self.rng.choice([0.0, np.pi / 2])))
            else:
                y = float(near.model.bounds[1][1]) + distance + model.size[1] / 2
                placed = self.new(model, near.to_world(np.array([0.0, y, 0.0])), near.yaw)
            if self.within(placed, 0.03) and not self.collides(placed, 0.01):
                return self.keep(placed)
        return None
