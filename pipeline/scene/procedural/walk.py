"""The way a person walks: a collision-free line through every room and through the doorways between."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pipeline.scene.procedural.floor_grid import CELL_M, FloorGrid, flood
from pipeline.scene.procedural.home import Home
from pipeline.scene.procedural.layout import Doorway, Layout

STOPS = (2, 4)
"""Places visited in each room, least and most (exclusive)."""
ROOMY = 4
"""Cells of free floor around a stop that count as enough."""
NARROW = 2.0
"""Extra cost of a step right beside something, relative to its length."""
APART_M = 0.9
"""Least distance between the stops in one room, where there is room for it."""


@dataclass(frozen=True, slots=True)
class Walk:
    """A walked line."""

    points: Float[np.ndarray, "P 2"]
    """Floor points, a few centimetres apart, metres."""
    stops: Int[np.ndarray, "K"]
    """Indices of the points at which the person stands still."""


def walkable(home: Home) -> FloorGrid:
    """Return the grid of the whole apartment: rooms and open doorways are free, all else is blocked."""
    rooms = home.layout.rooms
    low = np.min([room.low for room in rooms], axis=0) - 2 * CELL_M
    high = np.max([room.high for room in rooms], axis=0) + 2 * CELL_M
    grid = FloorGrid(low, np.ones(tuple(np.ceil((high - low) / CELL_M).astype(int)), bool))
    x, y = grid.centers()
    for number, room in enumerate(rooms):
        inside_x = (x > room.low[0]) & (x < room.high[0])
        inside_y = (y > room.low[1]) & (y < room.high[1])
        own = FloorGrid.of_room(room, grid)
        for thing in home.by_room.get(number, []):
            own.block(thing)
        inside = inside_x[:, None] & inside_y[None, :]
        grid.blocked[inside] = own.blocked[inside]
    for way in home.layout.doorways:
        if way.passable and way.below >= 0 and way.above >= 0:
            _open(grid, way)
    return grid


def _open(grid: FloorGrid, way: Doorway) -> None:
    """Free the cells along the middle of a doorway, as far as the landings on both sides."""
    x, y = way.center
    for t in np.arange(-0.45, 0.46, CELL_M / 2):
        for side in (-CELL_M / 2, 0.0, CELL_M / 2):
            point = (x + t, y + side) if way.axis == 0 else (x + side, y + t)
            grid.blocked[grid.cell(*point)] = False


def stroll(home: Home, rng: np.random.Generator) -> Walk:
    """Return a walk that starts in the first room and visits a few places in every room.

    Rooms come in depth-first order of their doorways; on the way to the next room the walk passes
    through rooms already seen.
    """
    grid = walkable(home)
    first = _places(grid, home.layout, 0, 1, rng)[0]
    grid.blocked = ~flood(grid.blocked, first)
    goals = [first]
    for number in _room_order(home.layout, rng):
        goals += _places(grid, home.layout, number, int(rng.integers(*STOPS)), rng)
    cells, stops = [first], [0]
    for goal in goals[1:]:
        cells += shortest(grid.blocked, cells[-1], goal)[1:]
        stops.append(len(cells) - 1)
    points = grid.low + (np.array(cells) + 0.5) * CELL_M
    return Walk(_smoothed(points, grid), np.array(stops))


def _room_order(layout: Layout, rng: np.random.Generator) -> list[int]:
    """Rooms in depth-first order over passable doorways, from the first room."""
    order: list[int] = []
    stack = [0]
    while stack:
        room = stack.pop()
        if room in order:
            continue
        order.append(room)
        ways = [way for way in layout.doorways if way.passable and room in (way.below, way.above)]
        beyond = [way.above if way.below == room else way.below for way in ways]
        stack += [int(other) for other in rng.permutation(np.array(beyond, int)) if other >= 0 and other not in order]
    return order


def _places(
    grid: FloorGrid, layout: Layout, number: int, count: int, rng: np.random.Generator
) -> list[tuple[int, int]]:
    """Free cells of a room, apart from each other; never none, since furnishing keeps floor free."""
    room = layout.rooms[number]
    x, y = grid.centers()
    inside = ((x > room.low[0]) & (x < room.high[0]))[:, None] & ((y > room.low[1]) & (y < room.high[1]))[None, :]
    open_floor = inside & ~grid.blocked
    free = rng.permutation(np.argwhere(open_floor))
    # People stop where there is room around them, not with the nose at a door: open places come first.
    free = free[np.argsort(-_freedom(open_floor)[free[:, 0], free[:, 1]].clip(max=ROOMY), kind="stable")]
    chosen: list[tuple[int, int]] = []
    for cell in free:
        if len(chosen) == count:
            break
        if all(np.hypot(*(cell - other)) * CELL_M >= APART_M for other in chosen):
            chosen.append((int(cell[0]), int(cell[1])))
    return chosen


def _freedom(free: Bool[np.ndarray, "X Y"]) -> Int[np.ndarray, "X Y"]:
    """How many cells away the nearest blocked one is, up to ROOMY."""
    depth = np.zeros(free.shape, np.int64)
    for _ in range(ROOMY):
        depth += free
        grown = free.copy()
        grown[1:] &= free[:-1]
        grown[:-1] &= free[1:]
        grown[:, 1:] &= free[:, :-1]
        grown[:, :-1] &= free[:, 1:]
        free = grown
    return depth


_STEPS = [(i, j, float(np.hypot(i, j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


def shortest(blocked: Bool[np.ndarray, "X Y"], start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the cells of a cheapest way by A*; both ends must be free and connected.

    A step costs its length, and more where something is near: people keep to the middle of free floor.
    """
    walls: list[list[bool]] = blocked.tolist()
    price = (1.0 + NARROW * (ROOMY - _freedom(~blocked)) / ROOMY).tolist()
    cost = {start: 0.0}
    came: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, start)]
    done: set[tuple[int, int]] = set()
    while queue:
        _, here = heapq.heappop(queue)
        if here == goal:
            break
        if here in done:
            continue
        done.add(here)
        i, j = here
        for di, dj, length in _STEPS:
            there = (i + di, j + dj)
            # No cutting of corners: both side cells of a diagonal step must be free.
            if walls[i + di][j + dj] or walls[i + di][j] or walls[i][j + dj]:
                continue
            new = cost[here] + length * price[i + di][j + dj]
            if new < cost.get(there, np.inf):
                cost[there], came[there] = new, here
                rest = float(np.hypot(there[0] - goal[0], there[1] - goal[1]))
                heapq.heappush(queue, (new + rest, there))
    way = [goal]
    while way[-1] != start:
        way.append(came[way[-1]])
    return way[::-1]


def _smoothed(points: Float[np.ndarray, "P 2"], grid: FloorGrid) -> Float[np.ndarray, "P 2"]:
    """Relax the grid's steps into curves; a point that would enter a blocked cell stays where it was."""
    points = points.copy()
    for _ in range(12):
        middle = (points[:-2] + points[2:]) / 2
        moved = 0.5 * points[1:-1] + 0.5 * middle
        cells = ((moved - grid.low) // CELL_M).astype(int)
        free = ~grid.blocked[cells[:, 0], cells[:, 1]]
        points[1:-1][free] = moved[free]
    return points
