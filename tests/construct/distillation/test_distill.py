"""Labels on Gaussians: against every point tried one by one, by laws, and at the edges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pipeline.construct.distillation.distill as module
from pipeline.construct.distillation.distill import DistillConfig, distill
from pipeline.scene import Gaussians
from schemas.errors import InputError
from tests.construct.distill_reference import brute_force

CLEAR = 1e-6
"""Lead of the winner from which two ways to sum a thousand float64 weights must agree on it."""
FLOAT32 = 1e-5


def make(means: object, log_scales: object, quats: object = (1.0, 0.0, 0.0, 0.0)) -> Gaussians:
    centres = np.asarray(means, np.float32).reshape(-1, 3)
    count = len(centres)
    return Gaussians(
        centres,
        np.broadcast_to(np.asarray(quats, np.float32), (count, 4)).copy(),
        np.broadcast_to(np.asarray(log_scales, np.float32), (count, 3)).copy(),
        np.zeros(count, np.float32),
        np.zeros((count, 1, 3), np.float32),
    )


def rough(rng: np.random.Generator, count: int, low: float = -5.0, high: float = 0.5) -> Gaussians:
    """Gaussians of 7 mm to 1.6 m in and around the unit square of `sheet`."""
    means = rng.uniform(-0.3, 1.3, (count, 3)) * [1, 1, 0.1]
    return make(means, rng.uniform(low, high, (count, 3)), rng.normal(size=(count, 4)))


def sheet(rng: np.random.Generator, count: int, kinds: int = 6) -> tuple[np.ndarray, np.ndarray]:
    points = rng.uniform(0, 1, (count, 3)) * [1, 1, 0.05]
    # Patches of labels with ragged borders; every third point is unlabelled or stray.
    labels = (points[:, 0] * kinds).astype(np.int32)
    stray = rng.random(count) < 0.3
    labels[stray] = rng.integers(-1, kinds, int(stray.sum()))
    return points.astype(np.float32), labels


def assert_as_brute_force(
    gaussians: Gaussians, points: np.ndarray, labels: np.ndarray, reach: float = 5.0, most: int = 1000
) -> None:
    found = distill(gaussians, points, labels, DistillConfig(reach=reach, most=most))
    truth = brute_force(gaussians, points, labels, reach=reach, most=most)
    np.testing.assert_array_equal(found.candidates, truth.candidates)
    clear = truth.lead > CLEAR
    np.testing.assert_array_equal(found.label[clear], truth.label[clear])
    np.testing.assert_allclose(found.purity[clear], truth.purity[clear], rtol=FLOAT32)
    np.testing.assert_allclose(found.nearest, truth.nearest, rtol=FLOAT32)
    assert clear.mean() > 0.9


@pytest.mark.parametrize(("reach", "most"), [(5.0, 1000), (5.0, 1), (2.0, 37), (0.3, 5), (5.0, 10**6)])
def test_labels_are_those_of_every_point_tried_against_every_gaussian(reach: float, most: int) -> None:
    rng = np.random.default_rng(most)
    points, labels = sheet(rng, 3000)
    assert_as_brute_force(rough(rng, 150), points, labels, reach, most)


@settings(max_examples=40, deadline=None)  # the first call compiles
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 12), st.integers(1, 3))
def test_points_on_a_lattice_give_the_same_labels_as_brute_force(seed: int, points: int, most: int, kinds: int) -> None:
    """Lattices are full of equal distances and of points at one place."""
    rng = np.random.default_rng(seed)
    cloud = rng.integers(0, 4, (points, 3)).astype(np.float32) / 4
    labels = rng.integers(-1, kinds, points).astype(np.int32)
    gaussians = make(rng.integers(0, 4, (8, 3)) / 4, rng.choice([-3.0, -1.5, -0.5], (8, 1)))
    found = distill(gaussians, cloud, labels, DistillConfig(most=most))
    truth = brute_force(gaussians, cloud, labels, most=most)
    np.testing.assert_array_equal(found.label, truth.label)
    np.testing.assert_array_equal(found.candidates, truth.candidates)


def test_neither_order_nor_chunks_nor_threads_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    points, labels = sheet(rng, 2000)
    gaussians = rough(rng, 120)
    once = distill(gaussians, points, labels)
    monkeypatch.setattr(module, "CHUNK", 7)
    parts = distill(gaussians, points, labels, threads=2)
    for name in ("label", "purity", "nearest", "candidates"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(once, name))
    order, mixed = rng.permutation(len(points)), rng.permutation(len(gaussians))
    # Random points have no equal distances, so the candidates are the same set in any order.
    again = distill(gaussians.take(mixed), points[order], labels[order])
    np.testing.assert_array_equal(again.label, once.label[mixed])
    np.testing.assert_array_equal(again.candidates, once.candidates[mixed])


def test_renaming_labels_renames_the_result() -> None:
    rng = np.random.default_rng(4)
    points, labels = sheet(rng, 1000)
    gaussians = rough(rng, 60)
    names = np.array([7, 40, 1000, 1001, 2**31 - 2, 2**31 - 1, -1], np.int32)
    np.testing.assert_array_equal(
        distill(gaussians, points, names[labels]).label, names[distill(gaussians, points, labels).label]
    )


class TestEdges:
    POINTS = np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, -0.1, 0]], np.float32)

    def label(self, gaussians: Gaussians, labels: list[int], **config: float) -> int:
        found = distill(gaussians, self.POINTS, np.array(labels, np.int32), DistillConfig(**config))
        return int(found.label[0])

    def test_a_tie_goes_to_the_lowest_label(self) -> None:
        gaussians = make([0, 0, 0], np.log(0.1))
        assert self.label(gaussians, [5, 3, 9, 4]) == 3
        assert self.label(gaussians, [5, 3, 5, 3]) == 3
        assert self.label(gaussians, [5, -1, 5, -1]) == -1

    def test_of_candidates_at_one_distance_the_first_count(self) -> None:
        gaussians = make([0, 0, 0], np.log(0.1))
        assert self.label(gaussians, [5, 3, 3, 3], most=1) == 5
        assert self.label(gaussians, [5, 5, 3, 3], most=2) == 5

    def test_a_long_gaussian_takes_what_lies_along_it(self) -> None:
        along_x = make([0, 0, 0], np.log([0.2, 0.02, 0.02]))
        assert self.label(along_x, [8, 8, 2, 2]) == 8
        half = np.sqrt(0.5)
        turned = make([0, 0, 0], np.log([0.2, 0.02, 0.02]), (half, 0, 0, half))
        assert self.label(turned, [8, 8, 2, 2]) == 2

    def test_a_point_on_the_rim_is_a_candidate_and_one_beyond_is_not(self) -> None:
        points = np.array([[1.25, 0, 0]])
        gaussians = make([[0, 0, 0], [-1e-3, 0, 0]], np.log(0.25))
        reach = 1.25 / float(np.exp(np.float64(np.float32(np.log(0.25)))))
        found = distill(gaussians, points, np.array([4], np.int32), DistillConfig(reach=reach * (1 + 1e-12)))
        assert found.label.tolist() == [4, -1]
        assert found.candidates.tolist() == [1, 0]
        assert (found.purity[1], found.nearest[1]) == (0.0, np.inf)

    def test_unlabelled_points_vote_so_that_neighbours_do_not_spread_over_them(self) -> None:
        at_the_left = make([-0.1, 0, 0], np.log(0.05))
        assert self.label(at_the_left, [7, -1, 7, 7]) == -1
        assert self.label(at_the_left, [7, 6, 7, 7]) == 6

    def test_a_thin_gaussian_off_the_surface_keeps_its_weights_and_farthest_refuses_it(self) -> None:
        above = make([0.09, 0, 0.1], np.log([0.1, 0.1, 0.001]))
        assert self.label(above, [7, 1, 2, 3]) == 7
        assert self.label(above, [7, 1, 2, 3], farthest=99.0) == -1
        assert self.label(above, [7, 1, 2, 3], farthest=101.0) == 7

    def test_flat_gaussians_reach_along_their_plane_and_a_mere_point_reaches_nothing(self) -> None:
        assert self.label(make([0.1, 0, 0], [np.log(0.1), np.log(0.1), -np.inf]), [7, 1, 1, 1]) == 7
        assert self.label(make([0.11, 0, 0], -np.inf), [7, 1, 1, 1]) == -1

    def test_gaussians_of_any_size_are_labelled(self) -> None:
        sizes = make(np.tile([0.1, 0, 0], (4, 1)), np.array([[-80.0], [0.0], [40.0], [80.0]]))
        found = distill(sizes, self.POINTS, np.array([7, 7, 7, 1], np.int32))
        assert found.label.tolist() == [7, 7, 7, 7]

    def test_no_gaussian_gives_no_label(self) -> None:
        found = distill(make(np.empty((0, 3)), 0.0), self.POINTS, np.zeros(4, np.int32))
        assert found.label.shape == found.purity.shape == (0,)


def test_clumps_far_points_and_huge_gaussians_are_exact() -> None:
    """What breaks a grid of cells: a point a thousand kilometres away, and most points at one place."""
    rng = np.random.default_rng(5)
    points, labels = sheet(rng, 2000)
    points = np.concatenate([points, np.full((3000, 3), 0.4, np.float32), [[1e6, 0, 0]]]).astype(np.float32)
    labels = np.concatenate([labels, rng.integers(0, 3, 3001).astype(np.int32)])
    assert_as_brute_force(rough(rng, 60, -3.0, 3.0), points, labels)


def test_a_gaussian_of_metres_costs_its_candidates_and_not_all_points() -> None:
    """Counted in time: 300 Gaussians that hold all of 300,000 points take less than 90 million distances would."""
    import time

    rng = np.random.default_rng(6)
    points, labels = sheet(rng, 300_000)
    huge = make(rng.uniform(0, 1, (300, 3)), np.log(3.0))
    distill(huge.take(slice(0, 1)), points[:10], labels[:10])
    start = time.thread_time()
    found = distill(huge, points, labels)
    assert (found.candidates == 1000).all()
    spent = time.thread_time() - start
    start = time.thread_time()
    for mean in huge.means[:30]:
        ((points - mean) ** 2).sum(axis=1)
    assert spent < 10 * (time.thread_time() - start)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.empty((0, 3), np.float32), "labels": np.empty(0, np.int32)}, "at least one point"),
        ({"points": np.array([[0, np.nan, 0]], np.float32), "labels": np.zeros(1, np.int32)}, "point 0"),
        ({"labels": np.full(4, -2, np.int32)}, "ids from 0, or -1 for unlabelled, found -2"),
    ],
)
def test_bad_points_and_labels_are_refused(change: dict[str, np.ndarray], message: str) -> None:
    given_ = {"points": TestEdges.POINTS, "labels": np.zeros(4, np.int32)} | change
    with pytest.raises(InputError, match=message):
        distill(make([0, 0, 0], 0.0), **given_)


def test_resampled_scan_gets_the_labels_of_the_surface_it_was_drawn_on(shared_data: Path) -> None:
    from pipeline.construct.mesh.mesh_surfels import density_surfels
    from pipeline.construct.mesh.scannet_mesh import read_scan

    _, mesh, labels, _ = read_scan(shared_data / "scannet_scene0000_00")
    rng = np.random.default_rng(0)
    drawn = density_surfels(mesh, 100.0, rng)
    moved = (drawn.gaussians.means + rng.normal(0, 0.01, drawn.gaussians.means.shape)).astype(np.float32)
    gaussians = replace(drawn.gaussians, means=moved, log_scales=drawn.gaussians.log_scales - np.float32(1))
    found, origin = distill(gaussians, mesh.vertices, labels.instance), labels.instance[drawn.vertex]
    assert (found.label >= 0).mean() == pytest.approx((origin >= 0).mean(), abs=0.01)
    both = (found.label >= 0) & (origin >= 0)
    assert (found.label == origin)[both].mean() > 0.94


@pytest.mark.slow
def test_two_million_gaussians_and_points_stay_under_one_and_a_half_gigabytes(shared_data: Path) -> None:
    from benchmarks.distillation import memory

    assert memory(shared_data / "scannet_scene0000_00", 2_000_000, threads=2)
