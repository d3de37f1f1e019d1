"""Rows turned into columns, and the sort by depth, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from pipeline.render.simd_kernels import load, store
from pipeline.render.sort_kernels import sort_upper_half
from pipeline.render.transpose_kernels import transpose_bits, transposed


@njit
def _transpose(source, target):
    rows = transposed(
        load(source, 0), load(source, 8), load(source, 16), load(source, 24),
        load(source, 32), load(source, 40), load(source, 48), load(source, 56),
    )  # fmt: skip
    for k in range(8):
        store(target, 8 * k, rows[k])


@njit
def _transpose_bits(words, masks):
    transpose_bits(words, masks)


def test_transposed_turns_eight_rows_into_columns() -> None:
    source, target = np.arange(64, dtype=np.float32), np.empty(64, np.float32)
    _transpose(source, target)
    np.testing.assert_array_equal(target.reshape(8, 8), source.reshape(8, 8).T)


def test_transpose_bits_puts_bit_b_of_word_k_into_bit_k_of_mask_b() -> None:
    words = np.random.default_rng(0).integers(0, 2**32, 64, dtype=np.uint32)
    masks = np.empty(32, np.uint64)
    _transpose_bits(words, masks)
    bits = (words[:, None] >> np.arange(32, dtype=np.uint32)) & 1
    expected = (bits.T.astype(np.uint64) << np.arange(64, dtype=np.uint64)).sum(axis=1, dtype=np.uint64)
    np.testing.assert_array_equal(masks, expected)


@pytest.mark.parametrize(("low", "high"), [(7, 8), (0, 2), (2**30, 2**30 + 9000), (3, 2**32), (0, 2**32)])
def test_sort_upper_half_is_numpys_stable_sort(low: int, high: int) -> None:
    upper = np.random.default_rng(1).integers(low, high, 20_000).astype(np.uint64)
    keys = (upper << np.uint64(32)) | np.arange(20_000, dtype=np.uint64)
    expected = keys[np.argsort(upper, kind="stable")]
    np.testing.assert_array_equal(sort_upper_half(keys, np.empty_like(keys)), expected)
