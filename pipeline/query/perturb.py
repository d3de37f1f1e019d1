"""Novel views around an initial view: moved a step, turned back toward the cluster, kept out of surfaces (paper 3.2).

The paper moves left, right, forward and backward and gives no magnitudes. Here a step keeps the camera's height
(gravity-aligned) but for `up` and `down`, and any move but forward and backward turns the camera about the vertical
toward the cluster's centre (and pitches it for `up` and `down`), by no more than a limit: a full turn of a fixed angle
would carry a distant cluster out of the other side of the image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline.geometry import Camera, look_at
from pipeline.query.explore_config import ExploreConfig
from pipeline.render import PreparedGaussians, nearby, render

Move = Literal["left", "right", "forward", "backward", "up", "down", "forward_left", "forward_right"]

MOVES: dict[int, tuple[Move, ...]] = {
    0: (),
    1: ("forward",),
    2: ("left", "right"),
    4: ("left", "right", "forward", "backward"),
    8: ("left", "right", "forward", "backward", "up", "down", "forward_left", "forward_right"),
}
"""Moves by V. The paper names those of V = 4; the others are ours (docs/decisions/0003-novel-views.md)."""

_STEPS: dict[Move, tuple[float, float, float]] = {
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "forward": (0, 0, 1),
    "backward": (0, 0, -1),
    "up": (0, 1, 0),
    "down": (0, -1, 0),
    "forward_left": (-1, 0, 1),
    "forward_right": (1, 0, 1),
}
"""Direction of a move along (right, up, forward) of the level frame."""

NEAR_PROBE_M = 0.02
"""Near plane of a probe: a recorded camera may stand closer to a surface than the renderer's 0.2 m."""
PROBE_PIXELS = 32
"""Side of the probe's depth image; its lens spans 90 degrees, so a pixel covers 2.5 cm at 0.4 m."""
PROBE_ALPHA = 0.5
"""Opacity from which a probe pixel counts as surface: fainter haze is passed through."""


class NovelViewConfig(BaseModel):
    """How many novel views, how far off, and how they stay out of surfaces (paper 3.2 and supplement D)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    policy: Literal["perturb", "explore"] = Field(
        default="perturb",
        description="perturb: the paper's moves. explore: the best poses of free space, see docs/novel_views.md.",
    )
    count: int = Field(
        default=4,
        ge=0,
        le=8,
        description="V, novel views per cluster; 0 keeps the initial view alone. Moves are known for 1, 2, 4 and 8.",
    )
    distance_m: float = Field(default=0.3, gt=0, description="Length of a move, metres (not given in the paper).")
    turn_deg: float = Field(
        default=15.0,
        ge=0,
        le=90,
        description="Most that a move turns toward the cluster, degrees (not given in the paper).",
    )
    clearance_m: float = Field(default=0.1, gt=0, description="Least distance kept from surfaces along a move, metres.")
    avoid_surfaces: bool = Field(default=True, description="Shorten moves that would end in or behind a surface.")
    explore: ExploreConfig = Field(default_factory=ExploreConfig, description="The search, with policy explore.")

    @model_validator(mode="after")
    def _count_has_moves(self) -> NovelViewConfig:
        if self.policy == "perturb" and self.count not in MOVES:
            raise ValueError(f"count: expected one of {', '.join(map(str, MOVES))} with policy perturb")
        return self

    @property
    def moves(self) -> tuple[Move, ...]:
        """The V moves, in order."""
        return MOVES[self.count]


@dataclass(frozen=True, slots=True)
class NovelPose:
    """One novel pose."""

    move: str
    """How it was moved, or explore_1, explore_2, ... in the order they were chosen."""
    camera: Camera
    """The initial view's lens at the new pose."""
    requested_m: float
    """Length asked for, metres; that of the move made where the pose was searched for."""
    moved_m: float
    """Distance from the initial view, metres."""


def perturbed_pose(
    camera: Camera,
    move: Move,
    distance_m: float,
    turn_deg: float,
    target: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
) -> Camera:
    """Return the camera moved by `distance_m` and turned toward the target by at most `turn_deg`.

    Args:
        camera: The initial view.
        move: Which way.
        distance_m: Metres.
        turn_deg: Most it turns, degrees; forward and backward never turn.
        target: The cluster's centre, metres, world frame.
        up: Unit vector opposite to gravity.
    """
    center = camera.center + distance_m * move_direction(camera, move, up)
    rotation = camera.world_to_camera[:, :3]
    if move in ("forward", "backward"):
        if distance_m == 0:
            return camera  # the very same pose, so that its picture and its answer are those of the initial view
    else:
        yaw = _clipped(_yaw_to(rotation, target - center, up), turn_deg)
        rotation = rotation @ _rotation(up, -yaw)
        if move in ("up", "down"):
            pitch = _clipped(_pitch_to(rotation, target - center, up), turn_deg)
            rotation = rotation @ _rotation(_level_frame(rotation, up)[0], -pitch)
    return camera.moved_to(np.concatenate([rotation, -(rotation @ center)[:, None]], axis=1))


def move_direction(camera: Camera, move: Move, up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return the unit direction of a move in the world: horizontal, or vertical for up and down."""
    step = np.array(_STEPS[move], np.float64) @ np.stack(_level_frame(camera.world_to_camera[:, :3], up))
    return step / np.linalg.norm(step)


def free_distance(
    gaussians: PreparedGaussians,
    camera: Camera,
    direction: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    config: NovelViewConfig,
) -> float:
    """Return how far the camera can go along a direction before it comes within the clearance of a surface, metres.

    A small depth image of the Gaussians that reach so near is rendered from the camera's centre along the direction.
    Surface points in the tube of radius `clearance_m` around the path bound the move; a surface that starts nearer than
    the clearance allows no move.

    Args:
        gaussians: The scene, or what lies within `probed_m` of the camera.
        camera: Where the move starts; only its centre counts.
        direction: Unit vector of the move, world frame.
        up: Unit vector opposite to gravity.
        config: Length asked for and clearance.

    Returns:
        Between 0 and `config.distance_m`.
    """
    # 90 degrees take in the whole tube from one clearance ahead; what is nearer is too near to begin with.
    half = PROBE_PIXELS / 2
    K = np.array([[half, 0, half], [0, half, half], [0, 0, 1]])
    probe = Camera(K, look_at(camera.center, camera.center + direction, up), PROBE_PIXELS, PROBE_PIXELS)
    image = render(gaussians, probe, outputs=("depth", "alpha"), near=NEAR_PROBE_M)
    assert image.depth is not None
    assert image.alpha is not None
    points = probe.unproject(image.depth.astype(np.float64))
    solid = (image.alpha >= PROBE_ALPHA) & (np.hypot(points[..., 0], points[..., 1]) <= config.clearance_m)
    nearest = float(points[..., 2][solid].min(initial=np.inf))
    return min(config.distance_m, max(0.0, nearest - config.clearance_m))


def probed_m(config: NovelViewConfig) -> float:
    """Return the distance from the camera beyond which nothing can bound a move, metres."""
    return float(np.hypot(config.distance_m + config.clearance_m, config.clearance_m))


def novel_poses(
    gaussians: PreparedGaussians,
    camera: Camera,
    target: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    config: NovelViewConfig,
    free: dict[Move, float] | None = None,
) -> tuple[NovelPose, ...]:
    """Return the V perturbed poses of an initial view, in the order of `config.moves`.

    Args:
        gaussians: The scene, for the probes.
        camera: The initial view.
        target: The cluster's centre, metres.
        up: Unit vector opposite to gravity.
        config: Count, lengths and limits.
        free: Free distances by move where they are known; those missing are probed and added. They depend on the
            initial view alone, so clusters that share it share them.
    """
    free = {} if free is None else free
    around: PreparedGaussians | None = None
    poses = []
    for move in config.moves:
        if move not in free:
            if around is None and config.avoid_surfaces:
                around = nearby(gaussians, camera.center, probed_m(config))
            free[move] = config.distance_m
            if around is not None:
                free[move] = free_distance(around, camera, move_direction(camera, move, up), up, config)
        moved = perturbed_pose(camera, move, free[move], config.turn_deg, target, up)
        poses.append(NovelPose(move, moved, config.distance_m, free[move]))
    return tuple(poses)


def explored_pose(number: int, initial: Camera, camera: Camera) -> NovelPose:
    """Return a pose that was searched for as the `number`-th novel view of a cluster, counted from 1."""
    moved = float(np.linalg.norm(camera.center - initial.center))
    return NovelPose(f"explore_{number}", camera, moved, moved)


def _level_frame(
    rotation: Float[np.ndarray, "3 3"], up: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Right, up and forward of the camera with pitch and roll taken out, as unit vectors of the world."""
    forward = rotation[2] - (rotation[2] @ up) * up
    if np.linalg.norm(forward) < 1e-6:
        # Looking straight up or down: the top of the image stands for forward (it does when tilting down).
        top = -rotation[1] * -np.sign(rotation[2] @ up)
        forward = top - (top @ up) * up
    forward = forward / np.linalg.norm(forward)
    return np.cross(forward, up), up, forward


def _yaw_to(rotation: Float[np.ndarray, "3 3"], offset: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]) -> float:
    """Angle about `up`, radians, counter-clockwise from above, from the level forward axis to the offset."""
    right, _, forward = _level_frame(rotation, up)
    return float(np.arctan2(-(offset @ right), offset @ forward))


def _pitch_to(rotation: Float[np.ndarray, "3 3"], offset: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]) -> float:
    """Angle about the level right axis, radians, upward, from the optical axis to the elevation of the offset."""
    _, _, forward = _level_frame(rotation, up)
    own = np.arctan2(rotation[2] @ up, rotation[2] @ forward)
    flat = np.linalg.norm(offset - (offset @ up) * up)
    return float(np.arctan2(offset @ up, flat) - own)


def _clipped(angle: float, limit_deg: float) -> float:
    limit = np.deg2rad(limit_deg)
    return float(np.clip(angle, -limit, limit))


def _rotation(axis: Float[np.ndarray, "3"], angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix about a unit axis, radians (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
