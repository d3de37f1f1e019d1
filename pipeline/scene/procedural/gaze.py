"""Where the person looks while walking: mostly ahead and down, at times at things, seldom straight at any of them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from pipeline.geometry import Camera
from pipeline.scene.procedural.placement import Home
from pipeline.scene.procedural.things import Placed
from pipeline.scene.procedural.walk import Walk
from pipeline.scene.views import View

FIELD_OF_VIEW = np.deg2rad(66.0)
"""Horizontal field of view of a wearable camera or a phone held upright."""
EYE_M = 1.55
"""Height of the camera."""
BOB_M, SWAY_M = 0.025, 0.02
"""Rise and fall, and sideways sway, of a walking head."""
STEP_M = 0.7
"""Length of a step: the head bobs once a step."""
DWELL = 2
"""Views taken at every stop, while the person looks around."""
MODES = {"ahead": 0.42, "glance": 0.24, "down": 0.16, "aside": 0.18}
"""How often each way of looking is taken up."""
AIM_ERROR = np.deg2rad(17.0)
"""Standard deviation of a glance's direction about the thing glanced at: many things are cut off by the image's edge."""
NOT_LOOKED_AT = ("floor", "ceiling", "wall", "light switch", "ceiling light")
"""Nobody turns the head for these."""


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
    views = []
    mode, target, left = "ahead", np.zeros(3), 0
    yaw, pitch = heading[0], -0.15
    for i in range(count):
        phase = np.pi * distance[i] / STEP_M
        side = np.array([-np.sin(heading[i]), np.cos(heading[i]), 0.0])
        eye = np.array([*position[i], EYE_M + BOB_M * np.cos(2 * phase)]) + SWAY_M * np.sin(phase) * side
        if left <= 0:
            mode = str(rng.choice(list(MODES), p=list(MODES.values())))
            left = int(rng.integers(2, 5))
            target = _target(home, eye, heading[i], mode, rng)
        left -= 1
        aim = target - eye
        want_yaw = np.arctan2(aim[1], aim[0]) if mode in ("glance", "aside") else heading[i]
        want_pitch = {"ahead": -0.17, "down": -0.75, "aside": -0.05}.get(
            mode, float(np.arctan2(aim[2], np.hypot(aim[0], aim[1])))
        )
        # The head covers most of the way to where it wants to look between two views: some views catch it on the way.
        share = float(rng.uniform(0.55, 1.0))
        yaw += share * ((want_yaw - yaw + np.pi) % (2 * np.pi) - np.pi)
        pitch += share * (want_pitch - pitch)
        error = rng.normal(0.0, AIM_ERROR, 2) * (1.0, 0.6)
        roll = float(rng.normal(0.0, np.deg2rad(2.0)))
        pose = _pose(eye, yaw + error[0], float(np.clip(pitch + error[1], -1.1, 0.35)), roll)
        views.append(View(f"{i:05d}", Camera(K, pose, width, height)))
    return tuple(views)


def _stations(
    walk: Walk, count: int
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Position, heading (radians) and distance walked of every view: even along the walk, with a pause at every stop."""
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


def _at(points: Float[np.ndarray, "P 2"], along: np.ndarray, distance: np.ndarray) -> Float[np.ndarray, "n 2"]:
    return np.stack([np.interp(distance, along, points[:, k]) for k in (0, 1)], axis=1)


def _target(home: Home, eye: Float[np.ndarray, "3"], heading: float, mode: str, rng: np.random.Generator) -> np.ndarray:
    """A point to look at: a thing in the same room for a glance, a random direction for looking aside."""
    if mode == "aside":
        turn = heading + float(rng.uniform(0.7, 2.4)) * float(rng.choice([-1.0, 1.0]))
        return eye + np.array([np.cos(turn), np.sin(turn), -0.1])
    things = [thing for thing in _room_things(home, eye) if 0.5 < np.linalg.norm(_middle(thing) - eye) < 4.5]
    if mode == "glance" and things:
        return _middle(things[int(rng.integers(len(things)))])
    return eye + np.array([np.cos(heading), np.sin(heading), -0.2])


def _room_things(home: Home, eye: np.ndarray) -> list[Placed]:
    for number, room in enumerate(home.layout.rooms):
        if room.contains(float(eye[0]), float(eye[1])):
            things = home.by_room.get(number, [])
            # People look at furniture and what stands on it, not into or under it.
            return [t for t in things if t.relation in ("", "on") and t.model.category not in NOT_LOOKED_AT]
    return []


def _middle(thing: Placed) -> Float[np.ndarray, "3"]:
    return thing.box.mean(axis=0)


def _pose(eye: Float[np.ndarray, "3"], yaw: float, pitch: float, roll: float) -> Float[np.ndarray, "3 4"]:
    """World-to-camera pose (OpenCV axes) looking along yaw and pitch (up is positive), rolled about the view axis."""
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    rotation = np.stack([c * right + s * down, -s * right + c * down, forward])
    return np.concatenate([rotation, -(rotation @ eye)[:, None]], axis=1)
