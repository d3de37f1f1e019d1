from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.query.view_quality import cells_of, footprint, times_seen, truncation, view_quality
from tests.query.tiny import camera_at

MEANS = np.array([[0, 3, 1], [0.2, 3, 1], [-9, 3, 1], [0, -3, 1], [0, 3, 1.2]], np.float64)
CAMERA = camera_at((0, 0, 1), (0, 3, 1), 4, 3)
"""Sees Gaussians 0, 1 and 4; 2 is far aside and 3 behind."""
DOMINANT = np.array([[-1, 4, 4, 4], [0, 0, 1, 4], [0, 0, 4, 4]], np.int32)
ALPHA = np.array([[0.0, 0.2, 0.5, 1], [1, 1, 1, 1], [1, 1, 1, 1]])
VIEW = footprint(DOMINANT, ALPHA, 5)
NOTHING = footprint(np.full((3, 4), -1, np.int32), np.zeros((3, 4)), 5)


def test_footprint_counts_pixels_sums_and_borders_by_gaussian() -> None:
    assert VIEW.ids.tolist() == [0, 1, 4]
    assert VIEW.pixels.tolist() == [4, 1, 6]
    assert VIEW.solid.tolist() == [4, 1, 5], "one pixel of the last is a fifth opaque"
    np.testing.assert_allclose(VIEW.sums, [[4, 8], [2.5, 1.5], [1.5 + 2.5 + 3.5 + 3.5 + 2.5 + 3.5, 1.5 + 1.5 + 5]])
    assert VIEW.border.tolist() == [True, False, True]
    assert (VIEW.width, VIEW.height) == (4, 3)


def test_empty_image_has_an_empty_footprint() -> None:
    assert len(NOTHING.ids) == len(NOTHING.pixels) == len(NOTHING.sums) == 0


def test_measures_of_a_hand_made_view() -> None:
    found = view_quality(VIEW, NOTHING, np.array([0, 1, 2, 3]), MEANS, CAMERA, np.array([2, 0, 0, 0, 1], np.int32))
    assert found.visibility == 2 / 4
    assert found.area == 5 / 12
    centroid = np.array([4 + 2.5, 8 + 1.5]) / 5
    assert found.centring == pytest.approx(np.linalg.norm(centroid - [2, 1.5]) / 2.5)
    assert found.truncation == 2 / 4
    assert found.touches_border
    assert found.new_gaussians == 2
    assert found.unobserved == pytest.approx(3 / 12), "the empty pixel, the faint one, and that of Gaussian 1"
    assert found.floaters == pytest.approx(5 / 12)


def test_inner_gaussian_touches_no_border_and_the_view_itself_has_nothing_new() -> None:
    found = view_quality(VIEW, VIEW, np.array([1]), MEANS, CAMERA, None)
    assert not found.touches_border
    assert (found.visibility, found.new_gaussians) == (1.0, 0)
    assert (found.unobserved, found.floaters) == (None, None)


@pytest.mark.parametrize("cluster", [np.array([2]), np.array([], np.int64)])
def test_cluster_without_pixels_has_the_worst_centring_and_no_area(cluster: np.ndarray) -> None:
    found = view_quality(VIEW, NOTHING, cluster, MEANS, CAMERA, None)
    assert (found.visibility, found.area, found.centring, found.new_gaussians) == (0.0, 0.0, 1.0, 0)
    assert not found.touches_border
    assert found.truncation == (1.0 if len(cluster) else 0.0)


def test_empty_image_is_unobserved_all_over() -> None:
    found = view_quality(NOTHING, VIEW, np.array([0]), MEANS, CAMERA, np.full(5, 9, np.int32))
    assert (found.unobserved, found.floaters, found.area) == (1.0, 0.0, 0.0)


def test_truncation_counts_what_is_behind_or_aside_whatever_hides_it() -> None:
    assert truncation(MEANS, CAMERA) == 2 / 5
    assert truncation(MEANS[:0], CAMERA) == 0.0
    assert truncation(MEANS[3:4], CAMERA) == 1.0


def test_times_seen_counts_views_by_cell_not_by_gaussian() -> None:
    means = np.array([[0.01, 0, 0], [0.09, 0, 0], [0.11, 0, 0], [5, 5, 5]], np.float32)
    seen = times_seen(means, np.array([0, 1, 1, 2]), np.array([0, 0, 7, 7]), cell_m=0.1)
    assert seen.tolist() == [2, 2, 1, 0], "the first two share a cell that views 0 and 7 saw"
    assert times_seen(means, np.zeros(0, np.int64), np.zeros(0, np.int64)).tolist() == [0, 0, 0, 0]
    assert len(times_seen(means[:0], np.zeros(0, np.int64), np.zeros(0, np.int64))) == 0


POINTS = st.lists(st.tuples(*[st.floats(-3, 3)] * 3), min_size=1, max_size=30)


@settings(deadline=None)
@given(POINTS)
def test_cells_are_numbered_without_gaps_and_hold_points_within_their_side(points: list[tuple[float, ...]]) -> None:
    places = np.array(points)
    cells = cells_of(places, 0.5)
    assert sorted(set(cells.tolist())) == list(range(cells.max() + 1))
    for cell in range(cells.max() + 1):
        assert np.ptp(places[cells == cell], axis=0).max() <= 0.5
    np.testing.assert_array_equal(cells == cells[0], (np.floor(places / 0.5) == np.floor(places[0] / 0.5)).all(axis=1))


def test_far_outliers_do_not_overflow_the_numbers_of_cells() -> None:
    cells = cells_of(np.array([[0, 0, 0], [0.2, 0, 0], [1e12, 1e12, 1e12]]), 0.1)
    assert len(set(cells.tolist())) == 3


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_footprint_agrees_with_counting_pixel_by_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dominant = rng.integers(-1, 6, (5, 7)).astype(np.int32)
    alpha = rng.random((5, 7))
    view = footprint(dominant, alpha, 6)
    np.testing.assert_array_equal(view.ids, np.unique(dominant[dominant >= 0]))
    for place, id in enumerate(view.ids):
        rows, columns = np.nonzero(dominant == id)
        assert view.pixels[place] == len(rows)
        assert view.solid[place] == (alpha[rows, columns] >= 0.5).sum()
        np.testing.assert_allclose(view.sums[place], [(columns + 0.5).sum(), (rows + 0.5).sum()])
        assert view.border[place] == bool(((rows % 4 == 0) | (columns % 6 == 0)).any())
