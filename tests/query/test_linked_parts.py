from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from pipeline.query.linked_parts import linked_parts


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 60), st.floats(0.01, 1.0), st.integers(0, 1000))
def test_linked_parts_are_the_components_of_all_short_pairs(count: int, within_m: float, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(0, 1, (count, 3)) + 50.0
    expected = connected_components(cdist(points, points) <= within_m, directed=False)[1]
    found = linked_parts(points, within_m)
    assert len(set(zip(expected.tolist(), found.tolist(), strict=True))) == len(set(expected.tolist()))
    assert set(found.tolist()) == set(range(expected.max() + 1))


@pytest.mark.parametrize(("within_m", "expected"), [(0.5, [0, 0, 1]), (0.4, [0, 1, 2]), (10.0, [0, 0, 0])])
def test_a_step_of_exactly_the_distance_links(within_m: float, expected: list[int]) -> None:
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [4.0, 0, 0]])
    assert linked_parts(points, within_m).tolist() == expected


def test_points_at_one_place_are_linked_and_no_points_have_no_part() -> None:
    assert linked_parts(np.ones((30, 3)), 0.0).tolist() == [0] * 30
    assert linked_parts(np.empty((0, 3)), 1.0).shape == (0,)
