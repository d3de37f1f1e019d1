from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pipeline.query.cluster import ClusterConfig, cluster_ids
from pipeline.query.split_clusters import split_cluster
from tests.query.tiny import box_points

STEP_M = 0.15
"""Boxes below are grids of 0.1 m: their own points are linked, those of boxes 0.2 m apart are not."""


def _boxes(*places: float, counts: int = 2) -> np.ndarray:
    return np.concatenate([box_points((x, 0, 0), (0.1 * counts, 0.2, 0.2)) for x in places])


def _split(means: np.ndarray, fewest: int = 20) -> list[int]:
    ids = np.arange(len(means), dtype=np.int32)
    return [len(part) for part in split_cluster(ids, means, STEP_M, fewest)]


def test_boxes_that_no_short_step_links_come_apart() -> None:
    means = _boxes(0.0, 0.6, 1.2)
    size = len(means) // 3
    parts = split_cluster(np.arange(len(means), dtype=np.int32), means, STEP_M, 20)
    assert [part.tolist() for part in parts] == [list(range(i * size, (i + 1) * size)) for i in range(3)]


def test_one_box_and_boxes_that_touch_stay_whole() -> None:
    assert len(_split(_boxes(0.0))) == 1
    assert len(_split(_boxes(0.0, 0.5))) == 1


def test_a_small_part_goes_to_the_nearest_large_one() -> None:
    stray = np.array([[0.9, 0.0, 0.0], [0.92, 0.0, 0.0]])
    means = np.concatenate([_boxes(0.0, 0.6), stray])
    large = (len(means) - 2) // 2
    assert _split(means) == [large, large + 2]


def test_parts_under_the_fewest_are_no_objects() -> None:
    means = _boxes(0.0, 0.6)
    half = len(means) // 2
    assert _split(means, fewest=half) == [half, half]
    assert _split(means, fewest=half + 1) == [2 * half]


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 120), st.floats(0.0, 0.5), st.integers(0, 1000))
def test_split_keeps_every_gaussian_once(count: int, step_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ids = np.sort(rng.choice(500, count, replace=False)).astype(np.int32)
    parts = split_cluster(ids, rng.uniform(0, 1, (500, 3)), step_m, 2)
    assert np.array_equal(np.sort(np.concatenate(parts)), ids)
    assert all((np.diff(part) > 0).all() for part in parts)


def test_config_splits_what_epsilon_joins_and_is_off_by_default() -> None:
    means = _boxes(0.0, 0.6)
    ids, half = np.arange(len(means), dtype=np.int32), len(means) // 2
    whole = ClusterConfig(epsilon_m=0.3)
    assert whole.split_epsilons == 0
    assert [len(c) for c in cluster_ids(ids, means, whole)] == [2 * half]
    apart = whole.model_copy(update={"split_epsilons": STEP_M / 0.3})
    assert [c.tolist() for c in cluster_ids(ids, means, apart)] == [list(range(half)), list(range(half, 2 * half))]


@pytest.mark.parametrize("wrong", [-0.1, 1.1])
def test_config_refuses_steps_below_0_and_above_epsilon(wrong: float) -> None:
    with pytest.raises(ValidationError, match="split_epsilons"):
        ClusterConfig(split_epsilons=wrong)
