from __future__ import annotations

from pipeline.query.view_subset import spread_views
from tests.query.tiny import camera_at


def test_every_nth_view_is_taken_from_the_first_on() -> None:
    cameras = [camera_at((x, 0, 0), (x, 5, 0)) for x in range(7)]
    assert spread_views(cameras) == tuple(range(7))
    assert spread_views(cameras, every_nth=3) == (0, 3, 6)
    assert spread_views([], every_nth=3) == ()


def test_farthest_views_span_the_walk_and_the_directions() -> None:
    walk = [camera_at((x, 0, 0), (x, 5, 0)) for x in range(9)]
    assert spread_views(walk, most=2) == (0, 8)
    assert spread_views(walk, most=3) == (0, 4, 8)
    turn = [camera_at((0, 0, 0), target) for target in ((0, 5, 0), (1, 5, 0), (5, 0, 0), (0, -5, 0))]
    assert spread_views(turn, most=2) == (0, 3)
    assert spread_views(turn, most=3) == (0, 2, 3)


def test_subsets_combine_and_equal_poses_are_taken_once_each() -> None:
    walk = [camera_at((x, 0, 0), (x, 5, 0)) for x in range(9)]
    assert spread_views(walk, every_nth=2, most=3) == (0, 4, 8)
    assert spread_views(walk[:1] * 4, most=3) == (0, 1, 2)
    assert spread_views(walk, most=20) == tuple(range(9))
