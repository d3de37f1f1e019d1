from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pipeline.geometry import Camera, look_at
from pipeline.query.perturb import (
    MOVES,
    Move,
    NovelViewConfig,
    explored_pose,
    free_distance,
    move_direction,
    novel_poses,
    perturbed_pose,
)
from pipeline.render import PreparedGaussians, prepare
from tests.query.tiny import UP, box_points, camera_at, gaussians_at

ALL_MOVES = MOVES[8]
TARGET = np.array([0.0, 3.0, 0.5])
FAR = prepare(gaussians_at(box_points((0, 40, 0), (0.2, 0.2, 0.2))))
NUMBERS = st.floats(-3, 3)


def _camera(eye: tuple[float, float, float] = (0, 0, 1), target: tuple[float, float, float] = (0, 3, 0.5)) -> Camera:
    return camera_at(eye, target)


def _bearing_deg(camera: Camera, target: np.ndarray) -> float:
    """Signed horizontal angle from the optical axis to a point, positive to the right."""
    forward, offset = camera.forward, target - camera.center
    right = np.cross(forward, UP)
    return float(np.rad2deg(np.arctan2(offset @ right / np.linalg.norm(right), offset[:2] @ forward[:2])))


@pytest.mark.parametrize(
    ("move", "expected"),
    [
        ("left", (-1, 0, 0)),
        ("right", (1, 0, 0)),
        ("forward", (0, 1, 0)),
        ("backward", (0, -1, 0)),
        ("up", (0, 0, 1)),
        ("down", (0, 0, -1)),
        ("forward_left", (-(0.5**0.5), 0.5**0.5, 0)),
        ("forward_right", (0.5**0.5, 0.5**0.5, 0)),
    ],
)
def test_moves_follow_gravity_not_the_tilt_of_the_camera(move: Move, expected: tuple[float, float, float]) -> None:
    tilted = _camera((0, 0, 2), (0, 3, 0))
    np.testing.assert_allclose(move_direction(tilted, move, UP), expected, atol=1e-12)


@pytest.mark.parametrize("move", ["forward", "backward"])
def test_forward_and_backward_keep_the_rotation(move: Move) -> None:
    camera = _camera()
    moved = perturbed_pose(camera, move, 0.3, 15.0, TARGET, UP)
    np.testing.assert_array_equal(moved.world_to_camera[:, :3], camera.world_to_camera[:, :3])
    np.testing.assert_allclose(np.linalg.norm(moved.center - camera.center), 0.3)


@pytest.mark.parametrize("move", ["left", "right", "up", "down", "forward_left", "forward_right"])
def test_other_moves_turn_to_centre_a_target_within_the_limit(move: Move) -> None:
    camera = camera_at((0, 0, 1), (0.3, 3, 0.5))
    moved = perturbed_pose(camera, move, 0.3, 25.0, TARGET, UP)
    pixel = moved.project(TARGET[None])[0][0]
    assert pixel[0] == pytest.approx(moved.width / 2, abs=1e-6)
    if move in ("up", "down"):
        assert pixel[1] == pytest.approx(moved.height / 2, abs=1e-6)


def test_left_turns_right_and_right_turns_left_for_a_target_ahead() -> None:
    camera = _camera()
    left, right = (perturbed_pose(camera, move, 0.3, 15.0, TARGET, UP) for move in ("left", "right"))
    assert left.forward[0] > 0 > right.forward[0]
    np.testing.assert_allclose(left.forward * [-1, 1, 1], right.forward, atol=1e-12)


def test_turn_is_limited_for_a_target_at_the_edge() -> None:
    camera = _camera()
    aside = np.array([4.0, 3.0, 0.5])
    moved = perturbed_pose(camera, "left", 0.3, 15.0, aside, UP)
    turned = np.rad2deg(
        np.arccos(np.clip(moved.forward[:2] @ camera.forward[:2] / (camera.forward[:2] ** 2).sum(), -1, 1))
    )
    assert turned == pytest.approx(15)
    assert abs(_bearing_deg(moved, aside)) < abs(_bearing_deg(camera, aside))


@settings(deadline=None)
@given(
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.sampled_from(ALL_MOVES),
    st.floats(0.0, 1.0),
    st.floats(0.0, 45.0),
)
def test_perturbed_poses_are_rigid_keep_the_horizon_and_move_by_the_length(
    eye: tuple[float, float, float],
    aim: tuple[float, float, float],
    target: tuple[float, float, float],
    move: Move,
    length: float,
    turn: float,
) -> None:
    start = np.array(eye)
    end = start + np.array(aim) + [0, 0, 1e-3] if np.linalg.norm(aim) < 1e-2 else start + np.array(aim)
    camera = _camera().moved_to(look_at(start, end, UP))
    moved = perturbed_pose(camera, move, length, turn, np.array(target), UP)
    rotation = moved.world_to_camera[:, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.norm(moved.center - camera.center) == pytest.approx(length, abs=1e-9)
    assert rotation[0] @ UP == pytest.approx(0, abs=1e-6), "the image's right axis stays level"
    assert camera.forward @ moved.forward >= np.cos(np.deg2rad(2 * turn)) - 1e-9


@pytest.mark.parametrize("straight", [(0, 0, -1), (0, 0, 1)])
@pytest.mark.parametrize("move", ALL_MOVES)
def test_a_camera_that_looks_straight_up_or_down_can_be_moved(straight: tuple[float, float, float], move: Move) -> None:
    camera = _camera().moved_to(look_at(np.zeros(3), np.array(straight, float), UP))
    moved = perturbed_pose(camera, move, 0.3, 15.0, np.array(straight) * 2.0, UP)
    assert np.isfinite(moved.world_to_camera).all()
    assert np.linalg.norm(moved.center) == pytest.approx(0.3)


def test_forward_of_a_camera_looking_down_is_the_top_of_its_image() -> None:
    down = _camera().moved_to(look_at(np.zeros(3), np.array([0.0, 1e-9, -1.0]), UP))
    top_of_image = -down.world_to_camera[1, :3]
    np.testing.assert_allclose(move_direction(down, "forward", UP), top_of_image, atol=1e-6)


class TestSurfaces:
    """A wall across the way, at several distances."""

    @staticmethod
    def _wall(distance: float) -> PreparedGaussians:
        points = box_points((0, distance, 1), (1.2, 0, 1.2), 0.05)
        return prepare(gaussians_at(points, scale_m=0.03))

    @pytest.mark.parametrize("distance", [0.15, 0.2, 0.25, 0.3, 0.35])
    def test_moves_end_a_clearance_before_the_wall(self, distance: float) -> None:
        config = NovelViewConfig()
        free = free_distance(self._wall(distance), _camera(), np.array([0.0, 1, 0]), UP, config)
        assert free == pytest.approx(distance - config.clearance_m, abs=0.02)

    def test_a_wall_nearer_than_the_clearance_allows_no_move(self) -> None:
        assert free_distance(self._wall(0.08), _camera(), np.array([0.0, 1, 0]), UP, NovelViewConfig()) == 0.0

    @pytest.mark.parametrize("distance", [0.6, 3.0])
    def test_a_wall_beyond_the_move_does_not_shorten_it(self, distance: float) -> None:
        assert free_distance(self._wall(distance), _camera(), np.array([0.0, 1, 0]), UP, NovelViewConfig()) == 0.3

    def test_a_wall_behind_does_not_stop_a_move_forward(self) -> None:
        assert free_distance(self._wall(-0.2), _camera(), np.array([0.0, 1, 0]), UP, NovelViewConfig()) == 0.3

    def test_an_object_beside_the_path_does_not_stop_it(self) -> None:
        post = prepare(gaussians_at(box_points((0.3, 0.25, 1), (0, 0, 0.5), 0.02), scale_m=0.02))
        assert free_distance(post, _camera(), np.array([0.0, 1, 0]), UP, NovelViewConfig()) == 0.3

    def test_haze_does_not_stop_a_move(self) -> None:
        haze = prepare(gaussians_at(np.array([[0.0, 0.2, 1.0]]), scale_m=0.2, opacity_logit=-2.0))
        assert free_distance(haze, _camera(), np.array([0.0, 1, 0]), UP, NovelViewConfig()) == 0.3

    def test_poses_say_what_was_asked_and_what_was_moved(self) -> None:
        camera = camera_at((0, 0, 1), (0, 3, 1))
        poses = {p.move: p for p in novel_poses(self._wall(0.2), camera, TARGET, UP, NovelViewConfig())}
        assert poses["forward"].requested_m == 0.3
        assert poses["forward"].moved_m == pytest.approx(0.1, abs=0.02)
        assert poses["backward"].moved_m == poses["left"].moved_m == 0.3
        for pose in poses.values():
            assert np.linalg.norm(pose.camera.center - camera.center) == pytest.approx(pose.moved_m)

    def test_a_blocked_step_forward_is_the_initial_pose_itself(self) -> None:
        camera = camera_at((0, 0, 1), (0, 3, 1))
        poses = {p.move: p for p in novel_poses(self._wall(0.08), camera, TARGET, UP, NovelViewConfig())}
        assert poses["forward"].moved_m == 0.0
        assert poses["forward"].camera is camera

    def test_avoidance_can_be_turned_off(self) -> None:
        config = NovelViewConfig(avoid_surfaces=False)
        poses = novel_poses(self._wall(0.08), camera_at((0, 0, 1), (0, 3, 1)), TARGET, UP, config)
        assert {pose.moved_m for pose in poses} == {0.3}


@pytest.mark.parametrize("count", [0, 1, 2, 4, 8])
def test_v_poses_come_in_the_order_of_the_moves(count: int) -> None:
    config = NovelViewConfig(count=count)
    poses = novel_poses(FAR, _camera(), TARGET, UP, config)
    assert tuple(pose.move for pose in poses) == config.moves
    assert len(poses) == count


@pytest.mark.parametrize("count", [3, 5, 9, -1])
def test_counts_without_moves_are_refused(count: int) -> None:
    with pytest.raises(ValidationError, match="count"):
        NovelViewConfig(count=count)


def test_a_search_takes_any_count_up_to_eight() -> None:
    assert NovelViewConfig(policy="explore", count=3).count == 3


def test_explored_pose_tells_its_distance_from_the_initial_view() -> None:
    camera = camera_at((0, 0, 1), (0, 3, 1))
    pose = explored_pose(2, camera, camera_at((3, 4, 1), (0, 3, 1)))
    assert (pose.move, pose.requested_m, pose.moved_m) == ("explore_2", 5.0, 5.0)


def test_four_moves_are_those_of_the_paper() -> None:
    assert set(NovelViewConfig().moves) == {"left", "right", "forward", "backward"}
    assert set(MOVES[2]) < set(MOVES[4]) < set(MOVES[8])


def test_known_free_distances_are_used_and_new_ones_kept() -> None:
    free: dict[Move, float] = {"left": 0.123}
    poses = novel_poses(FAR, _camera(), TARGET, UP, NovelViewConfig(), free)
    assert poses[0].moved_m == 0.123
    assert free == {"left": 0.123, "right": 0.3, "forward": 0.3, "backward": 0.3}
