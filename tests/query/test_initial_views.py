from __future__ import annotations

import numpy as np

from pipeline.query.initial_views import InitialView, InitialViewConfig, by_visible_size, initial_views
from pipeline.query.visibility import VisibilityCounts
from schemas.questions import Question


def _counts(rows: list[list[int]], sizes: list[int]) -> VisibilityCounts:
    return VisibilityCounts(np.array(rows, np.int64).reshape(len(sizes), -1), np.array(sizes, np.int64))


def test_the_view_with_the_highest_score_is_chosen() -> None:
    assert initial_views(_counts([[1, 5, 3], [0, 0, 2]], [10, 4])) == (InitialView(1, 0.5, 5), InitialView(2, 0.5, 2))


def test_ties_go_to_the_lowest_view() -> None:
    assert initial_views(_counts([[2, 7, 7, 7]], [8]))[0].view == 1


def test_a_cluster_that_no_view_sees_is_reported_without_a_view() -> None:
    assert initial_views(_counts([[0, 0]], [5])) == (InitialView(None, 0.0, 0),)


def test_a_scene_without_views_has_no_initial_view() -> None:
    assert initial_views(_counts([[]], [5])) == (InitialView(None, 0.0, 0),)


def test_clusters_are_ranked_by_visible_gaussians_with_ties_in_order() -> None:
    views = initial_views(_counts([[3], [0], [9], [3]], [3, 5, 90, 50]))
    assert by_visible_size(views) == (2, 0, 3, 1)


def test_the_cap_depends_on_the_task() -> None:
    config = InitialViewConfig(max_clusters_eqa=2, max_clusters_grounding=5)
    assert config.max_clusters(Question("q", "s", "eqa", "what?")) == 2
    assert config.max_clusters(Question("q", "s", "ground_one", "that")) == 5
    assert config.max_clusters(Question("q", "s", "ground_many", "those")) == 5
