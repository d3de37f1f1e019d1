"""Where a person can stand: a grid over the floor, blocked near furniture and walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pipeline.scene.procedural.layout import Room
from pipeline.scene.procedural.things import Placed

CELL_M = 0.1
"""Side of a cell."""
BODY_M = 0.26
"""Half the width of a person: the walk keeps this far from everything."""
FURNISHED_M = 0.31
"""Distance kept while furnishing: half a cell more, so that what is left open stays so on any grid."""
KNEE_M, REACH_M = 0.06, 1.75
"""Things lower than the first or hung above the second are walked over or under."""


@dataclass(slots=True)
class FloorGrid:
    """Cells of one rectangle of floor."""

    low: Float[np.ndarray, "2"]
    """Lowest x and y, metres."""
    blocked: Bool[np.ndarray, "X Y"]
    """Cells whose middle is too close to something."""
    body_m: float = BODY_M
    """Distance kept from everything, metres."""

    @classmethod
    def of_room(cls, room: Room, like: FloorGrid | None = None, body_m: float = BODY_M) -> FloorGrid:
        """Return the grid of an empty room, blocked along its walls; on the cells of `like` when given."""
        low, high = np.array(room.low), np.array(room.high)
        shape = np.ceil((high - low) / CELL_M).astype(int)
        if like is None:
            grid = cls(low, np.zeros(tuple(shape), bool), body_m)
        else:
            grid = cls(like.low, np.zeros_like(like.blocked), body_m)
        x, y = grid.centers()
        near_x = (x < low[0] + body_m) | (x > high[0] - body_m)
        near_y = (y < low[1] + body_m) | (y > high[1] - body_m)
        grid.blocked = near_x[:, None] | near_y[None, :]
        return grid

    def centers(self) -> tuple[Float[np.ndarray, "X"], Float[np.ndarray, "Y"]]:
        """Return the x of every column and the y of every row, metres."""
        nx, ny = self.blocked.shape
        return self.low[0] + (np.arange(nx) + 0.5) * CELL_M, self.low[1] + (np.arange(ny) + 0.5) * CELL_M

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Return the cell of a floor point, clipped to the grid."""
        i, j = int((x - self.low[0]) // CELL_M), int((y - self.low[1]) // CELL_M)
        nx, ny = self.blocked.shape
        return min(max(i, 0), nx - 1), min(max(j, 0), ny - 1)

    def block(self, placed: Placed) -> None:
        """Block the cells a thing takes."""
        if stands_in_the_way(placed):
            self.blocked |= self.shadow(placed)

    def shadow(self, placed: Placed) -> Bool[np.ndarray, "X Y"]:
        """Return the cells within a body's half width of a thing's upright box."""
        x, y = self.centers()
        (x0, y0, _), (x1, y1, _) = placed.box
        shadow = np.zeros_like(self.blocked)
        i = np.flatnonzero((x > x0 - self.body_m) & (x < x1 + self.body_m))
        j = np.flatnonzero((y > y0 - self.body_m) & (y < y1 + self.body_m))
        if len(i) and len(j):
            low, high = placed.model.bounds
            c, s = np.cos(placed.yaw), np.sin(placed.yaw)
            dx, dy = x[i, None] - placed.at[0], y[None, j] - placed.at[1]
            u, v = c * dx + s * dy, -s * dx + c * dy
            far_u = np.maximum(np.maximum(low[0] - u, u - high[0]), 0)
            far_v = np.maximum(np.maximum(low[1] - v, v - high[1]), 0)
            shadow[i[0] : i[-1] + 1, j[0] : j[-1] + 1] = np.hypot(far_u, far_v) < self.body_m
        return shadow

    def stays_open(self, added: Sequence[Placed], doors: Sequence[tuple[float, float]]) -> bool:
        """Return whether, with some things added, all doors stay connected and enough floor is left."""
        before = int((~self.blocked).sum())
        blocked = self.blocked.copy()
        for placed in added:
            if stands_in_the_way(placed):
                blocked |= self.shadow(placed)
        free = int((~blocked).sum())
        if free == before:
            return True
        reached = flood(blocked, self.cell(*doors[0]))
        cells = [self.cell(*door) for door in doors]
        return all(reached[cell] for cell in cells) and int(reached.sum()) >= max(30, 0.8 * free)


def stands_in_the_way(placed: Placed) -> bool:
    """Return whether a walking person would bump into a thing."""
    low, high = placed.box[:, 2]
    return bool(high > KNEE_M and low < REACH_M)


def flood(blocked: Bool[np.ndarray, "X Y"], start: tuple[int, int]) -> Bool[np.ndarray, "X Y"]:
    """Return the free cells that can be reached from a cell by steps to the four neighbours."""
    reached = np.zeros_like(blocked)
    reached[start] = not blocked[start]
    count = -1
    while count != (count := int(reached.sum())):
        grown = reached.copy()
        grown[1:] |= reached[:-1]
        grown[:-1] |= reached[1:]
        grown[:, 1:] |= reached[:, :-1]
        grown[:, :-1] |= reached[:, 1:]
        reached = grown & ~blocked
    return reached
