"""The floor plan: rooms in rows that share walls, and the doorways between them. Furniture is `rooms/`' work."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WALL_M = 0.12
"""Thickness of a wall."""
DOOR_WIDTH_M = 0.95
"""Clear width of a doorway."""
DOOR_HEIGHT_M = 2.05
"""Clear height of a doorway."""
CORNER_M = 0.52
"""Least distance from a doorway to the room's corner: an open door stands clear of the wall beside it."""

FIRST_ROOMS = ("living room", "kitchen", "bedroom")
"""Every apartment of three rooms or more has these."""
OTHER_ROOMS = ("bathroom", "office", "children's room", "dining room", "laundry room", "hallway", "guest room")
"""Drawn in random order for the rest; beyond them rooms repeat with a number."""
AREAS_M2 = {
    "living room": 23.0,
    "kitchen": 15.0,
    "bedroom": 16.0,
    "bathroom": 10.0,
    "office": 13.0,
    "children's room": 13.0,
    "dining room": 15.0,
    "laundry room": 9.5,
    "hallway": 9.5,
    "guest room": 13.0,
}
"""Typical floor areas; each is varied by up to 15 %."""

PLAN_TRIES = 24
"""Random plans drawn; the one whose worst room is least narrow is taken."""

XY = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Room:
    """One room: an upright box of air."""

    name: str
    """Unique name, such as "kitchen" or "bedroom 2"."""
    kind: str
    """Name without a number."""
    low: XY
    """Lowest x and y of the floor, inside the walls, metres."""
    high: XY
    """Highest x and y of the floor, metres."""
    height: float
    """Floor to ceiling, metres; the floor is z = 0."""

    @property
    def center(self) -> XY:
        """Middle of the floor, metres."""
        return ((self.low[0] + self.high[0]) / 2, (self.low[1] + self.high[1]) / 2)

    @property
    def area(self) -> float:
        """Floor area, square metres."""
        return (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])

    def contains(self, x: float, y: float, margin: float = 0.0) -> bool:
        """Return whether a floor point lies inside, at least `margin` metres from every wall."""
        inside_x = self.low[0] + margin <= x <= self.high[0] - margin
        return inside_x and self.low[1] + margin <= y <= self.high[1] - margin


@dataclass(frozen=True, slots=True)
class Doorway:
    """An opening in a wall, from floor to lintel."""

    axis: int
    """0 when the wall stands at constant x, 1 at constant y."""
    at: float
    """Coordinate of the wall's middle plane on that axis, metres."""
    low: float
    """Start of the opening along the wall, metres."""
    high: float
    """End of the opening along the wall, metres."""
    below: int
    """Room on the lower side of the wall; -1 outside."""
    above: int
    """Room on the upper side; -1 outside."""
    door: str
    """"open", "closed", or "" for an opening without a door."""

    @property
    def center(self) -> XY:
        """Middle of the threshold, metres."""
        middle = (self.low + self.high) / 2
        return (self.at, middle) if self.axis == 0 else (middle, self.at)

    @property
    def passable(self) -> bool:
        """Whether one can walk through."""
        return self.door != "closed"


@dataclass(frozen=True, slots=True)
class Layout:
    """The floor plan."""

    rooms: tuple[Room, ...]
    """Rooms; the first is where one enters."""
    doorways: tuple[Doorway, ...]
    """Openings, closed ones included."""


def make_layout(count: int, rng: np.random.Generator) -> Layout:
    """Return a plan of `count` rooms, all reachable from each other on foot."""
    names = _room_names(count, rng)
    kinds = [name.rstrip(" 0123456789") for name in names]
    areas = np.array([AREAS_M2[kind] for kind in kinds]) * rng.uniform(0.9, 1.15, count)
    height = float(rng.uniform(2.5, 2.7))
    plans = [_pack(areas, rng) for _ in range(PLAN_TRIES)]
    rects = min(plans, key=lambda plan: max(max(w, d) / min(w, d) + 1.5 / min(w, d) for _, _, w, d in plan))
    rooms = tuple(
        Room(name, kind, (round(x, 3), round(y, 3)), (round(x + w, 3), round(y + d, 3)), round(height, 3))
        for name, kind, (x, y, w, d) in zip(names, kinds, rects, strict=True)
    )
    return Layout(rooms, _doorways(rooms, rng))


def _room_names(count: int, rng: np.random.Generator) -> list[str]:
    names = list(FIRST_ROOMS[:count])
    number = 1
    while len(names) < count:
        kinds = list(rng.permutation(list(OTHER_ROOMS)))
        if number > 1:
            kinds += [str(k) for k in rng.permutation(["bedroom", "kitchen", "living room"])]
        # The first two extra rooms of a home are its bathroom and office, in either order.
        if number == 1:
            kinds = sorted(kinds, key=lambda kind: kind not in ("bathroom", "office"))
        names += [kind if number == 1 else f"{kind} {number}" for kind in kinds[: count - len(names)]]
        number += 1
    return [str(name) for name in names]


def _pack(areas: np.ndarray, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Lay rooms out in rows of one width; return x, y, width and depth of each room's floor."""
    count = len(areas)
    rows: list[list[int]] = [[] for _ in range(1 if count <= 2 else max(2, int(np.ceil(count / 4))))]
    for room in np.argsort(-areas * rng.uniform(0.7, 1.3, count), kind="stable"):
        min(rows, key=lambda row: float(areas[row].sum()) if row else 0.0).append(int(room))
    total_width = float(np.sqrt(areas.sum() * rng.uniform(0.7, 2.4)))
    rects = [(0.0, 0.0, 0.0, 0.0)] * count
    y = 0.0
    for row in rows:
        rng.shuffle(row)
        depth = float(areas[row].sum()) / total_width
        inner, x = total_width - WALL_M * (len(row) - 1), 0.0
        for room in row:
            width = inner * float(areas[room] / areas[row].sum())
            rects[room] = (x, y, width, depth)
            x += width + WALL_M
        y += depth + WALL_M
    return rects


def _doorways(rooms: tuple[Room, ...], rng: np.random.Generator) -> tuple[Doorway, ...]:
    """A random spanning tree of passable doorways, some further doors (open or closed) and a closed entrance."""
    shared = []
    for i, a in enumerate(rooms):
        for j, b in enumerate(rooms):
            for axis in (0, 1):
                if abs(b.low[axis] - a.high[axis] - WALL_M) < 0.01:
                    other = 1 - axis
                    low, high = max(a.low[other], b.low[other]), min(a.high[other], b.high[other])
                    if high - low >= DOOR_WIDTH_M + 2 * CORNER_M:
                        shared.append((axis, a.high[axis] + WALL_M / 2, low, high, i, j))
    group = list(range(len(rooms)))
    doorways = []
    for k in rng.permutation(len(shared)):
        axis, at, low, high, i, j = shared[k]
        if group[i] != group[j]:
            group = [group[i] if g == group[j] else g for g in group]
            door = "open" if rng.random() < 0.75 else ""
        elif rng.random() < 0.4:
            door = "closed" if rng.random() < 0.6 else "open"
        else:
            continue
        doorways.append(_place(axis, at, low, high, i, j, door, rng))
    doorways.append(_entrance(rooms, rng))
    assert len(set(group)) == 1, "rows of rooms always share enough wall for a doorway"
    return tuple(doorways)


def _place(
    axis: int, at: float, low: float, high: float, below: int, above: int, door: str, rng: np.random.Generator
) -> Doorway:
    """Put an opening near one end of the shared wall, where doors usually are."""
    slack = high - low - DOOR_WIDTH_M - 2 * CORNER_M
    offset = min(slack, float(rng.uniform(0.0, 0.25)))
    start = low + CORNER_M + (offset if rng.random() < 0.5 else slack - offset)
    return Doorway(axis, round(at, 3), round(start, 3), round(start + DOOR_WIDTH_M, 3), below, above, door)


def _entrance(rooms: tuple[Room, ...], rng: np.random.Generator) -> Doorway:
    """A closed door to the outside, in the hallway if there is one."""
    home = next((i for i, room in enumerate(rooms) if room.kind == "hallway"), 0)
    room = rooms[home]
    bottom, top = min(r.low[1] for r in rooms), max(r.high[1] for r in rooms)
    left, right = min(r.low[0] for r in rooms), max(r.high[0] for r in rooms)
    sides = []
    for axis, edge_low, edge_high in ((0, left, right), (1, bottom, top)):
        other = 1 - axis
        if abs(room.low[axis] - edge_low) < 0.01:
            sides.append((axis, edge_low - WALL_M / 2, room.low[other], room.high[other], -1, home))
        if abs(room.high[axis] - edge_high) < 0.01:
            sides.append((axis, edge_high + WALL_M / 2, room.low[other], room.high[other], home, -1))
    if not sides:
        # A hallway in the middle of three rows has no outside wall: enter through the first room of the plan's edge.
        home = next(i for i, r in enumerate(rooms) if abs(r.low[1] - bottom) < 0.01)
        sides = [(1, bottom - WALL_M / 2, rooms[home].low[0], rooms[home].high[0], -1, home)]
    return _place(*sides[int(rng.integers(len(sides)))], "closed", rng)
