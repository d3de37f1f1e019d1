from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.construct.upright import estimate_up
from pipeline.geometry import Camera, look_at
from pipeline.scene.captures import open_capture

K = np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]])


def level_cameras(up: np.ndarray, yaws: np.ndarray, pitch: float) -> list[Camera]:
    """Cameras without roll, tilted down by `pitch`, that look along `yaws` about `up`."""
    side = np.cross(up, [1.0, 0, 0] if abs(up[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    ahead = [np.cos(yaw) * side + np.sin(yaw) * other - np.tan(pitch) * up for yaw in yaws]
    return [Camera(K, look_at(np.zeros(3), direction, up), 64, 48) for direction in ahead]


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(directions, st.floats(0.6, 6), st.floats(-1.2, 1.2), st.integers(0, 100))
def test_level_cameras_that_turn_give_up_however_they_are_tilted(
    up: tuple[float, float, float], turn: float, pitch: float, seed: int
) -> None:
    truth = np.array(up) / np.linalg.norm(up)
    yaws = np.random.default_rng(seed).uniform(0, 6) + np.linspace(0, turn, 9)
    np.testing.assert_allclose(estimate_up(level_cameras(truth, yaws, pitch)), truth, atol=1e-6)


def test_cameras_that_look_one_way_give_the_up_of_their_images() -> None:
    up = np.array([0.0, 0.0, 1.0])
    (camera,) = level_cameras(up, np.zeros(1), 0.4)
    np.testing.assert_allclose(estimate_up([camera, camera]), -camera.world_to_camera[1, :3])


def test_kitchen_up_is_across_its_floor_and_tables(shared_data: Path) -> None:
    # The normal that most of its fused surface near this direction has, found apart from the cameras.
    floor = np.array([0.0105, -0.8797, -0.4753])
    found = estimate_up(open_capture(str(shared_data / "kitchen_7scenes")).cameras)
    assert np.degrees(np.arccos(found @ floor)) < 2.0
