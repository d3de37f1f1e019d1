"""Where a person could walk in a room, and a camera path there: eye-height poses that look around.

The map is a grid of floor cells. A cell is free when there is floor beneath it and nothing at body height within
reach; the path visits well-spread cells along shortest ways and turns the head while it goes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from pipeline.geometry import look_at
from schemas.errors import InputError

CELL_M = 0.05
"""Side of a floor cell: half the smallest gap a person notices."""
STEP_OVER_M = 0.25
"""Things lower than this over the floor do not stop a person."""
_LEAST_AREA_M2 = 0.3
"""Area a person needs to stand and turn in."""
HEADROOM_M = 0.25
"""Free height needed above the eye."""


@dataclass(frozen=True, slots=True)
class FloorMap:
    """Floor cells of a scene; z is up. Cell (i, j) covers origin + [i, i+1) x [j, j+1) cells."""

    origin: Float[np.ndarray, "2"]
    """Corner of cell (0, 0), metres."""
    floor_z: float
    """Height of the floor, metres."""
    free: Bool[np.ndarray, "I J"]
    """Where a person can stand: one area, or several that only a squeeze connects."""
    clearance_m: Float[np.ndarray, "I J"]
    """Distance to the nearest obstacle or edge of the floor, metres."""

    def centers(self, cells: Int64[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
        """Return the middles of cells, metres."""
        return self.origin + (cells + 0.5) * CELL_M

    def clearance_at(self, points: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k"]:
        """Return the clearance at horizontal positions, metres; 0 outside the map."""
        cells = np.floor((points - self.origin) / CELL_M).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.free.shape)).all(axis=1)
        cells = np.clip(cells, 0, np.array(self.free.shape) - 1)
        return np.where(inside, self.clearance_m[cells[:, 0], cells[:, 1]], 0.0)


def map_floor(
    points: Float[np.ndarray, "P 3"], floor_z: float, *, eye_m: float = 1.5, clearance_m: float = 0.3
) -> FloorMap:
    """Return where a person can stand.

    Args:
        points: Points on every surface, dense enough that no two neighbours are more than 5 cm apart; metres.
        floor_z: Height of the floor, metres.
        eye_m: Height of the eyes above the floor.
        clearance_m: Distance to keep from obstacles; halved, at most twice, where that leaves no room to stand.

    Raises:
        InputError: There is no floor, or nowhere to stand on it.
    """
    from scipy import ndimage

    origin = points[:, :2].min(axis=0) - 2 * CELL_M
    shape = np.ceil((points[:, :2].max(axis=0) - origin) / CELL_M).astype(np.int64) + 2
    height = points[:, 2] - floor_z

    def cells_of(chosen: Bool[np.ndarray, "P"]) -> Bool[np.ndarray, "I J"]:
        grid = np.zeros(shape, bool)
        cells = np.floor((points[chosen, :2] - origin) / CELL_M).astype(np.int64)
        grid[cells[:, 0], cells[:, 1]] = True
        return grid

    blocked = cells_of((height > STEP_OVER_M) & (height < eye_m + HEADROOM_M))
    floor = cells_of(np.abs(height) < 0.12)
    floor = ndimage.binary_closing(floor, iterations=4) & ~blocked
    clearance = ndimage.distance_transform_edt(floor) * CELL_M
    for wanted in (clearance_m, clearance_m / 2, clearance_m / 4):
        areas, count = ndimage.label(clearance >= wanted)
        if count:
            sizes = np.bincount(areas.ravel())[1:] * CELL_M**2
            large = 1 + np.flatnonzero(sizes >= max(_LEAST_AREA_M2, 0.02 * sizes.max()))
            if len(large):
                return FloorMap(origin, floor_z, np.isin(areas, large), clearance)
    raise InputError("floor map", expected="floor a person can stand on", found="none free of obstacles")


def walk(floor: FloorMap, steps: int, rng: np.random.Generator, *, stops: int = 14) -> Float[np.ndarray, "steps 2"]:
    """Return horizontal positions, evenly spaced along a walk through each free area.

    The walk visits cells chosen far from one another, nearest first, along shortest ways that prefer the middle of
    open space. Areas get steps and stops by their size, small ones a tenth at least.

    Args:
        floor: The map.
        steps: Positions wanted.
        rng: Source of the starting points.
        stops: Cells to visit in all.
    """
    from scipy import ndimage

    areas, count = ndimage.label(floor.free)
    sizes = np.bincount(areas.ravel(), minlength=count + 1)[1:].astype(np.float64)
    share = np.maximum(sizes / sizes.sum(), 0.1)
    ends = np.round(np.cumsum(share / share.sum()) * steps).astype(int)
    parts, start = [np.zeros((0, 2))], 0
    for area, end in enumerate(ends.tolist(), start=1):
        visited = max(2, round(stops * float(share[area - 1])))
        parts.append(_walk_area(floor, areas == area, end - start, visited, rng))
        start = end
    return np.concatenate(parts)


def _walk_area(
    floor: FloorMap, area: Bool[np.ndarray, "I J"], steps: int, stops: int, rng: np.random.Generator
) -> Float[np.ndarray, "steps 2"]:
    from scipy.sparse.csgraph import dijkstra

    graph, cells = _cell_graph(floor, area)
    begin = int(rng.integers(len(cells)))
    chosen = [int(dijkstra(graph, indices=np.array([begin])).argmax())]
    spread = dijkstra(graph, indices=np.array(chosen))[0]
    while len(chosen) < min(stops, len(cells)):
        chosen.append(int(spread.argmax()))
        spread = np.minimum(spread, dijkstra(graph, indices=np.array(chosen[-1:]))[0])
    between, back = dijkstra(graph, indices=np.array(chosen), return_predecessors=True)
    at, left = 0, set(range(1, len(chosen)))
    order = [chosen[0]]
    while left:
        following = min(sorted(left), key=lambda k: between[at, chosen[k]])
        order += _trace(back[at], chosen[at], chosen[following])
        at = following
        left.remove(at)
    track = floor.centers(cells[np.array(order)])
    if len(track) < 2:
        return np.repeat(track, steps, axis=0)
    track = _smooth(track)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))])
    at_m = np.linspace(0.0, lengths[-1], steps)
    return np.stack([np.interp(at_m, lengths, track[:, axis]) for axis in range(2)], axis=1)


def look_around(
    floor: FloorMap, positions: Float[np.ndarray, "N 2"], rng: np.random.Generator, *, eye_m: float = 1.5
) -> list[Float[np.ndarray, "3 4"]]:
    """Return world-to-camera poses of someone who walks through the positions and looks around.

    The head sways to both sides of the way ahead, in slow turns now and then all around, looks a little down, and
    turns away from surfaces right before the face. The camera stays level.
    """
    count = len(positions)
    ahead = np.gradient(_smooth(positions), axis=0) if count > 2 else np.ones_like(positions)
    heading = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    beat = np.arange(count)
    sway = np.deg2rad(75.0) * np.sin(2 * np.pi * beat / 11.0 + rng.uniform(0, 2 * np.pi))
    turns = np.deg2rad(100.0) * np.sin(2 * np.pi * beat / 37.0 + rng.uniform(0, 2 * np.pi))
    yaw = heading + sway + turns + rng.normal(0.0, np.deg2rad(8.0), count)
    pitch = np.deg2rad(-14.0) + np.deg2rad(9.0) * np.sin(2 * np.pi * beat / 7.0) + rng.normal(0, np.deg2rad(4.0), count)
    heights = floor.floor_z + eye_m + rng.normal(0.0, 0.03, count)
    poses = []
    for i in range(count):
        angle = _open_direction(floor, positions[i], float(yaw[i]))
        eye = np.array([*positions[i], heights[i]])
        tilt = float(np.clip(pitch[i], np.deg2rad(-40.0), np.deg2rad(10.0)))
        forward = np.array([np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)])
        poses.append(look_at(eye, eye + forward, np.array([0.0, 0.0, 1.0])))
    return poses


def _open_direction(floor: FloorMap, position: Float[np.ndarray, "2"], yaw: float, need_m: float = 0.9) -> float:
    """Return the direction nearest to `yaw` with open floor ahead, or the one with the most."""
    turns = np.deg2rad([0, 20, -20, 40, -40, 60, -60, 90, -90, 120, -120, 150, -150, 180])
    reach = np.arange(CELL_M, need_m + CELL_M, CELL_M)
    best, best_m = yaw, -1.0
    for turn in turns:
        direction = np.array([np.cos(yaw + turn), np.sin(yaw + turn)])
        closed = floor.clearance_at(position + reach[:, None] * direction) <= 0
        open_m = need_m if not closed.any() else float(reach[closed.argmax()])
        if open_m >= need_m:
            return yaw + float(turn)
        if open_m > best_m:
            best, best_m = yaw + float(turn), open_m
    return best


def _cell_graph(floor: FloorMap, area: Bool[np.ndarray, "I J"]) -> tuple[Any, Int64[np.ndarray, "k 2"]]:
    """Return the 8-neighbour graph of an area's cells and their indices; edges near obstacles cost more."""
    from scipy.sparse import csr_array

    cells = np.argwhere(area)
    number = np.full(floor.free.shape, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    rows, columns, costs = [], [], []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = cells + step
        inside = ((other >= 0) & (other < floor.free.shape)).all(axis=1)
        pairs = np.flatnonzero(inside)
        pairs = pairs[number[tuple(other[pairs].T)] >= 0]
        to = number[tuple(other[pairs].T)]
        clearance = np.minimum(floor.clearance_m[tuple(cells[pairs].T)], floor.clearance_m[tuple(cells[to].T)])
        rows.append(pairs)
        columns.append(to)
        costs.append(np.hypot(*step) * CELL_M * (1.0 + 0.5 / np.maximum(clearance, CELL_M)))
    row, column, cost = np.concatenate(rows), np.concatenate(columns), np.concatenate(costs)
    graph = csr_array(
        (np.tile(cost, 2), (np.concatenate([row, column]), np.concatenate([column, row]))), (len(cells),) * 2
    )
    return graph, cells


def _trace(back: Int[np.ndarray, "k"], start: int, end: int) -> list[int]:
    path = []
    while end != start:
        path.append(end)
        end = int(back[end])
    return path[::-1]


def _smooth(track: Float[np.ndarray, "k 2"], width: int = 9) -> Float[np.ndarray, "k 2"]:
    if len(track) < width:
        return track
    padded = np.concatenate([np.repeat(track[:1], width // 2, 0), track, np.repeat(track[-1:], width // 2, 0)])
    return np.stack([np.convolve(padded[:, axis], np.full(width, 1 / width), "valid") for axis in range(2)], axis=1)
