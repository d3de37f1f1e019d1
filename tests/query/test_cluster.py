from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.query.cluster import ClusterConfig, cluster_ids, cluster_points

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


def test_thinning_gives_every_gaussian_the_cluster_of_its_cube() -> None:
    rng = np.random.default_rng(7)
    points = np.concatenate([_box((0, 0, 0), 3000, rng), _box((2, 0, 0), 3000, rng)])
    full = cluster_points(points, CONFIG)
    thinned = cluster_points(points, ClusterConfig(voxel_m=0.05))
    assert len(np.unique(full)) == len(np.unique(thinned)) == 2
    assert len(np.unique(full * 10 + thinned)) == 2
