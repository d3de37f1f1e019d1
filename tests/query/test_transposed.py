from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.query.transposed import Transposed


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), gaussians=st.integers(1, 40), views=st.integers(0, 9), clusters=st.integers(0, 5)
)
def test_counts_equal_the_dense_product(seed: int, gaussians: int, views: int, clusters: int) -> None:
    rng = np.random.default_rng(seed)
    D = rng.random((views, gaussians)) < rng.random()
    C = rng.random((clusters, gaussians)) < rng.random()
    joined = Transposed.of([np.flatnonzero(row).astype(np.int32) for row in D], gaussians)
    found = joined.counts([np.flatnonzero(row).astype(np.int32) for row in C])
    np.testing.assert_array_equal(found, C.astype(np.int64) @ D.astype(np.int64).T)
    np.testing.assert_array_equal(joined.views, np.nonzero(D.T)[1])
    np.testing.assert_array_equal(np.diff(joined.starts), D.sum(axis=0))


def test_more_views_than_two_bytes_hold_take_four() -> None:
    row, nothing = np.array([1], np.int32), np.empty(0, np.int32)
    few = Transposed.of([nothing] * 65_535 + [row], 2)
    many = Transposed.of([nothing] * 65_536 + [row], 2)
    assert (few.views.dtype, few.views.tolist()) == (np.uint16, [65_535])
    assert (many.views.dtype, many.views.tolist()) == (np.uint32, [65_536])
    assert many.counts([row])[0].nonzero()[0].tolist() == [65_536]
    assert few.nbytes == 2 + 3 * 8


def test_index_beyond_the_scene_is_caught_before_it_is_read() -> None:
    joined = Transposed.of([np.array([0], np.int32)], 3)
    for wrong in (-1, 3):
        with pytest.raises(AssertionError):
            joined.counts([np.array([wrong], np.int32)])
