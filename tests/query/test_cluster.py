from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pipeline.metrics.cluster_quality import adjusted_rand, apart
from pipeline.query.cluster import ClusterConfig, cluster_ids, cluster_points, thin, with_distances
from pipeline.query.cluster_scale import SAMPLED, derived_epsilon

CONFIG = ClusterConfig()


def _box(center: tuple[float, float, float], count: int, rng: np.random.Generator, half: float = 0.25) -> np.ndarray:
    """Points on the faces of a cube."""
    points = rng.uniform(-half, half, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = half * np.sign(points[np.arange(count), axis])
    return points + center


def test_separate_objects_become_separate_clusters_larger_first() -> None:
    rng = np.random.default_rng(0)
    means = np.concatenate([_box((0, 0, 0), 200, rng), _box((2, 0, 0), 400, rng), _box((0, 3, 0), 300, rng)])
    found = cluster_ids(np.arange(900, dtype=np.int32), means, CONFIG)
    assert [len(ids) for ids in found] == [400, 300, 200]
    assert [ids[0] for ids in found] == [200, 600, 0]
    assert all((np.diff(ids) > 0).all() for ids in found)


def test_one_object_is_one_cluster_and_not_noise() -> None:
    points = _box((1, 1, 1), 300, np.random.default_rng(1))
    assert cluster_points(points, CONFIG).tolist() == [0] * 300


def test_objects_nearer_than_epsilon_stay_together() -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate([_box((0, 0, 0), 400, rng), _box((0.8, 0, 0), 400, rng)])
    apart = ClusterConfig(epsilon_m=0.1)
    together = ClusterConfig(epsilon_m=0.5)
    assert len(np.unique(cluster_points(points, apart))) == 2
    assert len(np.unique(cluster_points(points, together))) == 1


def test_noise_near_a_cluster_joins_it_and_noise_far_off_is_dropped() -> None:
    rng = np.random.default_rng(3)
    cubes = np.concatenate([_box((0, 0, 0), 300, rng), _box((3, 0, 0), 300, rng)])
    points = np.concatenate([cubes, [[0.5, 0, 0], [2.52, 0, 0], [1.5, 0, 4.0]]])
    labels = cluster_points(points, ClusterConfig(noise_join_m=0.3))
    assert labels[600] == labels[0]
    assert labels[601] == labels[300]
    assert labels[602] == -1
    ids = np.arange(603, dtype=np.int32)
    assert sum(len(cluster) for cluster in cluster_ids(ids, points, CONFIG)) == 602


@pytest.mark.parametrize("count", [1, 2, 19])
def test_a_category_smaller_than_a_cluster_is_one_cluster(count: int) -> None:
    points = np.random.default_rng(4).uniform(-9, 9, (count, 3))
    assert cluster_points(points, CONFIG).tolist() == [0] * count


def test_points_too_sparse_for_epsilon_are_one_cluster() -> None:
    points = np.random.default_rng(5).uniform(-10, 10, (400, 3))
    assert cluster_points(points, CONFIG).tolist() == [0] * 400


def test_sparse_objects_far_apart_stay_separate() -> None:
    rng = np.random.default_rng(8)
    points = np.concatenate([_box((0, 0, 0), 60, rng, half=1.0), _box((6, 0, 0), 60, rng, half=1.0)])
    labels = cluster_points(points, CONFIG)
    assert set(labels[:60]) & set(labels[60:]) <= {-1}
    assert set(labels) >= {0, 1}


def test_no_point_gives_no_cluster() -> None:
    assert cluster_ids(np.empty(0, np.int32), np.zeros((5, 3)), CONFIG) == ()


@pytest.mark.parametrize("count", [20, 21, 500])
def test_equal_points_are_one_cluster(count: int) -> None:
    assert cluster_points(np.ones((count, 3)), CONFIG).tolist() == [0] * count


def test_world_offset_does_not_change_clusters() -> None:
    rng = np.random.default_rng(6)
    points = np.concatenate([_box((0, 0, 0), 200, rng), _box((1.5, 0, 0), 200, rng)])
    np.testing.assert_array_equal(cluster_points(points, CONFIG), cluster_points(points + 1e5, CONFIG))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4), st.sampled_from([0.0, 0.05]))
def test_clusters_are_disjoint_subsets_and_repeat_exactly(seed: int, objects: int, voxel_m: float) -> None:
    rng = np.random.default_rng(seed)
    means = np.concatenate([_box(tuple(rng.uniform(-3, 3, 3)), int(rng.integers(5, 80)), rng) for _ in range(objects)])
    ids = np.flatnonzero(rng.random(len(means)) < 0.8).astype(np.int32)
    config = ClusterConfig(voxel_m=voxel_m)
    found, again = cluster_ids(ids, means, config), cluster_ids(ids, means, config)
    members = np.concatenate([np.empty(0, np.int32), *found])
    assert len(np.unique(members)) == len(members)
    assert set(members.tolist()) <= set(ids.tolist())
    assert (len(ids) == 0) == (len(found) == 0)
    assert all(a.tolist() == b.tolist() for a, b in zip(found, again, strict=True))


@pytest.mark.parametrize("scale", [0.01, 1.0, 250.0])
def test_default_distances_fit_a_scene_of_any_scale(scale: float) -> None:
    rng = np.random.default_rng(9)
    points = np.concatenate([_box((0, 0, 0), 400, rng), _box((0.9, 0, 0), 400, rng), _box((0, 3, 0), 90, rng)])
    labels = cluster_points(scale * points, CONFIG)
    np.testing.assert_array_equal(labels, cluster_points(points, CONFIG))
    assert len(np.unique(labels)) == 3


def test_with_distances_derives_what_is_null_and_keeps_what_is_given() -> None:
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(40), [0]), axis=-1).reshape(-1, 3) * 0.1
    # Of the 10 nearest on a square lattice the farthest are two steps off, but for points at the rim.
    derived = with_distances(grid, ClusterConfig())
    assert derived.epsilon_m == pytest.approx(2.5 * 0.2)
    assert derived.noise_join_m == pytest.approx(1.5 * 2.5 * 0.2)
    given_epsilon = with_distances(grid, ClusterConfig(epsilon_m=0.08))
    assert (given_epsilon.epsilon_m, given_epsilon.noise_join_m) == pytest.approx((0.08, 0.12))
    assert with_distances(grid, ClusterConfig(noise_join_m=0.0)).noise_join_m == 0.0
    assert with_distances(grid[:1], ClusterConfig()).epsilon_m == 0.0
    assert with_distances(np.tile(grid, (4, 1)), ClusterConfig(min_samples=3)).epsilon_m == 0.0


def test_derived_distance_of_many_points_is_that_of_an_even_sample() -> None:
    points = np.random.default_rng(14).uniform(0, 1, (3 * SAMPLED, 3)) * (4, 4, 0)
    cores = cKDTree(points).query(points, [11])[0]
    expected = 2.5 * np.quantile(cores, 0.75)
    assert derived_epsilon(points, 10) == pytest.approx(expected, rel=0.02)
    assert derived_epsilon(points[:SAMPLED], 10) > 1.5 * expected


def test_points_in_another_order_give_the_same_clusters() -> None:
    rng = np.random.default_rng(10)
    points = np.concatenate([_box((0, 0, 0), 900, rng), _box((0.8, 0.8, 0), 500, rng), _box((3, 0, 0), 40, rng)])
    shuffled = rng.permutation(len(points))
    labels, again = cluster_points(points, CONFIG), cluster_points(points[shuffled], CONFIG)
    assert adjusted_rand(apart(labels[shuffled]), apart(again)) == 1.0


def test_thinning_gives_every_gaussian_the_cluster_of_its_cube() -> None:
    rng = np.random.default_rng(7)
    points = np.concatenate([_box((0, 0, 0), 3000, rng), _box((2, 0, 0), 3000, rng)])
    full = cluster_points(points, CONFIG)
    thinned = cluster_points(points, ClusterConfig(voxel_m=0.05))
    assert len(np.unique(full)) == len(np.unique(thinned)) == 2
    assert adjusted_rand(full, thinned) == 1.0


def test_thinning_counts_gaussians_not_cubes() -> None:
    rng = np.random.default_rng(11)
    switch, lamp = rng.uniform(0.01, 0.04, (60, 3)), _box((2, 0, 0), 3000, rng)
    speck = rng.uniform((0.01, 4.01, 0.01), (0.04, 4.04, 0.04), (12, 3))
    config = ClusterConfig(voxel_m=0.05, epsilon_m=0.2, min_cluster_size=20)
    labels = cluster_points(np.concatenate([switch, lamp, speck]), config)
    assert len(set(labels[:60])) == 1
    assert labels[0] not in (-1, labels[60])
    assert set(labels[-12:]) == {-1}


def test_thin_puts_cubes_on_one_grid_whatever_the_points() -> None:
    points = np.random.default_rng(12).uniform(-1, 1, (500, 3))
    _, weights, member = thin(points, 0.25)
    means, _, half = thin(points[::2], 0.25)
    cells = np.floor(points / 0.25)
    assert weights.sum() == 500
    for cube in range(len(weights)):
        assert len(np.unique(cells[member == cube], axis=0)) == 1
    assert len(np.unique(cells, axis=0)) == len(weights)
    np.testing.assert_array_equal(np.floor(means / 0.25)[half], cells[::2])


def test_many_equal_places_give_what_each_gaussian_alone_would() -> None:
    rng = np.random.default_rng(13)
    places = np.concatenate([_box((0, 0, 0), 40, rng), _box((2, 0, 0), 40, rng)])
    points = np.repeat(places, 5, axis=0)
    assert len(thin(points, 0.0)[0]) == 80
    moved = points + rng.normal(0, 1e-9, points.shape)
    assert len(thin(moved, 0.0)[0]) == 400
    assert adjusted_rand(apart(cluster_points(points, CONFIG)), apart(cluster_points(moved, CONFIG))) == 1.0


@pytest.mark.parametrize("seed", range(4))
def test_our_tree_and_the_package_find_the_same_clusters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-3, 3, (12, 3))
    points = np.concatenate([_box(tuple(c), int(rng.integers(30, 300)), rng) for c in centres])
    points = np.concatenate([points, rng.uniform(-4, 4, (60, 3))])
    ours, theirs = (cluster_points(points, ClusterConfig(by=by)) for by in ("tree", "hdbscan"))
    # Edges as long as a core distance tie, and least spanning trees that differ in them move points at the rims.
    assert adjusted_rand(ours, theirs) > 0.998
    assert len(np.unique(ours)) == len(np.unique(theirs))
    assert ((ours < 0) != (theirs < 0)).mean() < 0.002


def test_the_package_takes_no_cubes() -> None:
    with pytest.raises(ValueError, match="voxel_m must be 0"):
        ClusterConfig(by="hdbscan", voxel_m=0.05)
