from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.query.explore_config import ExploreWeights
from pipeline.query.explore_objective import MOST_PATCHES, Sight, Target, look, make_target, score
from tests.query.tiny import box_points, camera_at

MEANS = np.concatenate([[[0.0, 3, 1], [0.01, 3, 1], [0.2, 3, 1]], [[0.0, 3, 1.3]], [[4.0, 3, 1]]])
CLUSTER = np.array([0, 1, 2])
CAMERA = camera_at((0, 0, 1), (0, 3, 1), 4, 3)


@pytest.fixture(scope="module")
def target() -> Target:
    return make_target(MEANS, CLUSTER, 0.5)


def test_patches_hold_neighbours_and_the_surroundings_come_after_them(target: Target) -> None:
    assert (target.patches, target.around) == (2, 1)
    assert target.patch[0] == target.patch[1] != target.patch[2]
    assert target.patch[3:].tolist() == [2, -1, -1], "what stands near, what does not, and the place of empty pixels"
    np.testing.assert_allclose(target.middle, [(0.005 + 0.2) / 2, 3, 1])


def test_without_surroundings_only_the_cluster_has_patches() -> None:
    assert make_target(MEANS, CLUSTER, 0.0).around == 0


def test_large_clusters_have_a_bounded_number_of_patches() -> None:
    points = box_points((0, 0, 0), (2, 2, 0.5), 0.1)
    target = make_target(points, np.arange(len(points)), 0.0)
    assert MOST_PATCHES / 3 < target.patches <= MOST_PATCHES
    assert target.radius_m == pytest.approx(np.sqrt(2 * 4 / 3 + 0.25 / 3), rel=0.1)


def test_look_measures_a_hand_made_dominance_image(target: Target) -> None:
    dominant = np.array([[-1, 0, 1, 3], [4, 4, 4, 4], [4, 4, 4, 4]], np.int32)
    sight = look(dominant, CAMERA, target, MEANS, np.array([1, 1, 1, 0, 1], np.int32))
    assert sight.seen.tolist() == [True, False, True]
    assert sight.area == 2 / 12
    assert sight.centring == pytest.approx(1.0 / 2.5), "the centroid is the middle of the first row"
    assert sight.unobserved == pytest.approx(2 / 12), "the empty pixel and the one that no view saw"
    assert sight.near == 0.0
    assert sight.truncation == 0.0


def test_near_surfaces_are_counted_by_depth(target: Target) -> None:
    close = camera_at((0, 2.6, 1), (0, 3, 1), 4, 3)
    dominant = np.array([[0, 0, 4, 4], [-1, -1, -1, -1], [4, 4, 4, 4]], np.int32)
    assert look(dominant, close, target, MEANS, np.ones(5, np.int32)).near == 8 / 12


def test_empty_image_shows_nothing(target: Target) -> None:
    sight = look(np.full((3, 4), -1, np.int32), CAMERA, target, MEANS, np.ones(5, np.int32))
    assert (sight.area, sight.centring, sight.unobserved, sight.near) == (0, 1, 1, 0)
    assert not sight.seen.any()


GOOD = Sight(np.array([True, True, True]), 0.06, 0.0, 0.0, 0.0, 0.0)
NOTHING_COVERED = np.zeros(3, bool)


def test_best_view_scores_the_sum_of_the_weights_for_it(target: Target) -> None:
    weights = ExploreWeights(around=0.5, size=0.3)
    assert score(GOOD, target, NOTHING_COVERED, weights) == pytest.approx(1.8)


def test_what_was_covered_adds_nothing(target: Target) -> None:
    weights = ExploreWeights(around=0.5, size=0.3)
    assert score(GOOD, target, np.array([True, False, False]), weights) == pytest.approx(1.3)
    assert score(GOOD, target, np.ones(3, bool), weights) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("change", "weight"),
    [
        ({"centring": 0.5}, "centring"),
        ({"truncation": 0.5}, "truncation"),
        ({"unobserved": 0.5}, "unobserved"),
        ({"near": 0.5}, "near"),
        ({"area": float(np.sqrt(0.003 * 0.06))}, "size"),
    ],
)
def test_each_fault_costs_half_its_weight_when_half_there(
    target: Target, change: dict[str, float], weight: str
) -> None:
    weights = ExploreWeights(**{weight: 0.8})
    worse = dataclasses.replace(GOOD, **change)
    lost = score(GOOD, target, NOTHING_COVERED, weights) - score(worse, target, NOTHING_COVERED, weights)
    assert lost == pytest.approx(0.4)


SIZES = (0.0, 1e-4, 0.003, 0.06, 1.0)


def test_size_counts_neither_below_nor_above_its_ends(target: Target) -> None:
    weights = ExploreWeights()
    at = [score(dataclasses.replace(GOOD, area=a), target, NOTHING_COVERED, weights) for a in SIZES]
    assert at[0] == at[1] == pytest.approx(at[2])
    assert at[3] == at[4] > at[2]
