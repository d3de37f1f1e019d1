"""Where the person looks while walking: mostly ahead, down or aside, at times at things, seldom straight at any.

Some things are overlooked: the person never frames what lies in boxes, under beds and behind seats (nor some
other things) in full on purpose, so that recorded views cut them off at the border. A step or a turn of the head shows
them; that is what novel views are for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pipeline.geometry import Camera
from pipeline.scene.procedural.home import Home
from pipeline.scene.procedural.things import Placed
from pipeline.scene.procedural.walk import Walk
from pipeline.scene.views import View

FIELD_OF_VIEW = np.deg2rad(64.0)
"""Horizontal field of view of a wearable camera or a phone held sideways."""
EYE_M = 1.55
"""Height of the camera."""
BOB_M, SWAY_M = 0.025, 0.02
"""Rise and fall, and sideways sway, of a walking head."""
STEP_M = 0.7
"""Length of a step: the head bobs once a step."""
DWELL = 2
"""Views taken at every stop, while the person looks around."""
MODES = {"ahead": 0.38, "glance": 0.30, "down": 0.14, "aside": 0.18}
"""How often each way of looking is taken up."""
AIM_ERROR = np.deg2rad(14.0)
"""Standard deviation of the direction about what was meant: many things are cut off by the image's edge."""
NOT_LOOKED_AT = ("floor", "ceiling", "wall", "light switch", "ceiling light")
"""Nobody turns the head for these."""
OVERLOOKED, OVERLOOKED_HIDDEN = 0.45, 0.65
"""Share of things, and of those in, under or behind others, that are never framed on purpose."""
ATTENTIVE = 0.12
"""Share of views in which overlooked things are framed as well as any other."""
NEAR_M = 4.0
"""Things farther away are small and stay in view."""
TURNS = np.deg2rad([0.0, -14.0, 14.0, -28.0, 28.0, -42.0, 42.0])
RISES = np.deg2rad([0.0, 10.0])
"""Turns and rises of the head tried so that overlooked things fall on the border."""


@dataclass(frozen=True, slots=True)
class _Watcher:
    """What decides where to look."""

    home: Home
    overlooked: list[np.ndarray]
    """Box corners (k 8 3) of the k overlooked things, by room."""
    half_view: Float[np.ndarray, "2"]
    """Half fields of view, horizontal and vertical, radians."""
    rng: np.random.Generator


def record(home: Home, walk: Walk, count: int, width: int, height: int, rng: np.random.Generator) -> tuple[View, ...]:
    """Return `count` named views along a walk.

    Args:
        home: The furnished apartment.
        walk: The walked line.
        count: Views wanted.
        width: Image width, pixels.
        height: Image height, pixels.
        rng: Source of glances.
    """
    position, heading, distance = _stations(walk, count)
    focal = width / (2 * np.tan(FIELD_OF_VIEW / 2))
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    half_view = np.arctan(np.array([width, height]) / (2 * focal))
    watcher = _Watcher(home, _overlooked(home, rng), half_view, rng)
    views = []
    mode, target, left = "ahead", np.zeros(3), 0
    yaw, pitch = float(heading[0]), -0.15
    for i in range(count):
        phase = np.pi * distance[i] / STEP_M
        side = np.array([-np.sin(heading[i]), np.cos(heading[i]), 0.0])
        eye = np.array([*position[i], EYE_M + BOB_M * np.cos(2 * phase)]) + SWAY_M * np.sin(phase) * side
        if left <= 0:
            mode = str(rng.choice(list(MODES), p=list(MODES.values())))
            left = int(rng.integers(2, 5))
            target = _target(home, eye, float(heading[i]), mode, rng)
        left -= 1
        want = _wanted(mode, target - eye, float(heading[i]))
        # The head covers most of the way to where it wants to look between two views: some views catch it on the way.
        share = float(rng.uniform(0.55, 1.0))
        yaw += share * ((want[0] - yaw + np.pi) % (2 * np.pi) - np.pi)
        pitch += share * (want[1] - pitch)
        aim = np.array([yaw, pitch]) + rng.normal(0.0, AIM_ERROR, 2) * (1.0, 0.6)
        if rng.random() > ATTENTIVE:
            aim = _turned_away(watcher, eye, aim)
        roll = float(rng.normal(0.0, np.deg2rad(2.0)))
        pose = _pose(eye, float(aim[0]), float(np.clip(aim[1], -1.1, 0.35)), roll)
        views.append(View(f"{i:05d}", Camera(K, pose, width, height)))
    return tuple(views)


def _stations(
    walk: Walk, count: int
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Position, heading (radians) and distance walked of every view: even along the walk, with pauses at the stops."""
    steps = np.linalg.norm(np.diff(walk.points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    pauses = along[walk.stops]
    dwell = min(DWELL, max(0, (count - 2) // (2 * len(pauses))))
    moving = count - dwell * len(pauses)
    distance = np.sort(np.concatenate([np.linspace(0.0, along[-1], max(moving, 1)), np.repeat(pauses, dwell)]))[:count]
    ahead = np.minimum(distance + 0.35, along[-1])
    behind = np.maximum(ahead - 0.7, 0.0)
    position, front, back = (_at(walk.points, along, d) for d in (distance, ahead, behind))
    direction = front - back
    return position, np.arctan2(direction[:, 1], direction[:, 0]), distance


def _at(
    points: Float[np.ndarray, "P 2"], along: Float[np.ndarray, "P"], distance: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2"]:
    return np.stack([np.interp(distance, along, points[:, k]) for k in (0, 1)], axis=1)


def _wanted(mode: str, aim: Float[np.ndarray, "3"], heading: float) -> tuple[float, float]:
    """Yaw and pitch of a way of looking."""
    if mode == "glance":
        return float(np.arctan2(aim[1], aim[0])), float(np.arctan2(aim[2], np.hypot(aim[0], aim[1])))
    if mode == "aside":
        return float(np.arctan2(aim[1], aim[0])), -0.05
    return heading, -0.75 if mode == "down" else -0.15


def _target(home: Home, eye: Float[np.ndarray, "3"], heading: float, mode: str, rng: np.random.Generator) -> np.ndarray:
    """A point to look at: a thing in the same room for a glance, a random direction for looking aside."""
    if mode == "aside":
        turn = heading + float(rng.uniform(0.7, 2.4)) * float(rng.choice([-1.0, 1.0]))
        return eye + np.array([np.cos(turn), np.sin(turn), -0.1])
    room = _room_at(home, eye)
    things = [t for t in home.by_room.get(room, []) if t.model.category not in NOT_LOOKED_AT and not _is_hidden(t)]
    middles = [thing.box.mean(axis=0) for thing in things]
    near = [middle for middle in middles if 0.5 < np.linalg.norm(middle - eye) < NEAR_M]
    if mode == "glance" and near:
        return near[int(rng.integers(len(near)))]
    return eye + np.array([np.cos(heading), np.sin(heading), -0.2])


def _room_at(home: Home, eye: Float[np.ndarray, "3"]) -> int:
    """The room over a floor point; -1 in a doorway."""
    inside = [k for k, room in enumerate(home.layout.rooms) if room.contains(float(eye[0]), float(eye[1]))]
    return inside[0] if inside else -1


def _is_hidden(thing: Placed) -> bool:
    return thing.relation in ("in", "under", "behind")


def _overlooked(home: Home, rng: np.random.Generator) -> list[np.ndarray]:
    result = []
    for number in range(len(home.layout.rooms)):
        things = [t for t in home.by_room.get(number, []) if t.model.category not in NOT_LOOKED_AT]
        chosen = [t for t in things if rng.random() < (OVERLOOKED_HIDDEN if _is_hidden(t) else OVERLOOKED)]
        boxes = np.array([thing.box for thing in chosen]).reshape(-1, 2, 3)
        bits = np.arange(8)[:, None] >> np.arange(3) & 1
        result.append(boxes[:, bits, np.arange(3)])
    return result


def _turned_away(watcher: _Watcher, eye: Float[np.ndarray, "3"], aim: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """The yaw and pitch near `aim` that put as few overlooked things as possible wholly into the image."""
    room = _room_at(watcher.home, eye)
    if room < 0 or not len(watcher.overlooked[room]):
        return aim
    ray = watcher.overlooked[room] - eye
    flat = np.hypot(ray[..., 0], ray[..., 1])
    near = flat.mean(axis=1) < NEAR_M
    azimuth, elevation = np.arctan2(ray[..., 1], ray[..., 0])[near], np.arctan2(ray[..., 2], flat)[near]
    turn, rise = (x.ravel() for x in np.meshgrid(TURNS, RISES, indexing="ij"))
    across = (azimuth[None] - aim[0] - turn[:, None, None] + np.pi) % (2 * np.pi) - np.pi
    up = elevation[None] - aim[1] - rise[:, None, None]
    inside = ((np.abs(across) < watcher.half_view[0]) & (np.abs(up) < watcher.half_view[1])).sum(axis=2)
    whole, part = (inside >= 6).sum(axis=1), ((inside > 0) & (inside < 6)).sum(axis=1)
    # Seeing part of a thing is what real captures do: it counts for a view, seeing the whole counts against it.
    cost = whole - 0.35 * part + 0.5 * np.abs(turn) + 0.5 * rise
    best = int(cost.argmin())
    return np.array([aim[0] + turn[best], aim[1] + rise[best]])


def _pose(eye: Float[np.ndarray, "3"], yaw: float, pitch: float, roll: float) -> Float[np.ndarray, "3 4"]:
    """World-to-camera pose (OpenCV axes) looking along yaw and pitch (up is positive), rolled about the view axis."""
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    rotation = np.stack([c * right + s * down, -s * right + c * down, forward])
    return np.concatenate([rotation, -(rotation @ eye)[:, None]], axis=1)
