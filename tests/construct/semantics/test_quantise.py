"""Product quantisation: nearest codes, small errors, and exact where few vectors differ."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.semantics.quantise import Codebooks, decode, encode, learn_codebooks
from schemas.errors import InputError


def test_codes_are_the_nearest_parts() -> None:
    rng = np.random.default_rng(0)
    books = Codebooks(rng.normal(size=(3, 256, 2)).astype(np.float32))
    vectors = rng.normal(size=(50, 6)).astype(np.float32)
    codes = encode(vectors, books)
    for part in range(3):
        far = np.linalg.norm(vectors[:, None, 2 * part : 2 * part + 2] - books.parts[part], axis=2)
        assert (codes[:, part] == far.argmin(axis=1)).all()


def test_few_different_vectors_come_back_exactly() -> None:
    kinds = np.random.default_rng(1).normal(size=(9, 8)).astype(np.float32)
    vectors = kinds[np.arange(300) % 9]
    books = learn_codebooks(vectors, 4, np.random.default_rng(0))
    assert (decode(encode(vectors, books), books) == vectors).all()


def test_unit_vectors_keep_their_direction() -> None:
    rng = np.random.default_rng(2)
    centres = rng.normal(size=(12, 32))
    vectors = centres[rng.integers(0, 12, 2000)] + 0.3 * rng.normal(size=(2000, 32))
    vectors = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float16)
    books = learn_codebooks(vectors, 16, rng)
    back = decode(encode(vectors, books), books)
    cosine = (back * vectors).sum(axis=1) / np.linalg.norm(back, axis=1)
    assert np.median(cosine) > 0.99
    assert cosine.min() > 0.95


def test_codes_that_nothing_needs_are_no_fault() -> None:
    rng = np.random.default_rng(3)
    few = np.concatenate([np.repeat(rng.normal(size=(2, 4)), 3000, axis=0), rng.normal(size=(400, 4))])
    books = learn_codebooks((few + 1e-3 * rng.normal(size=few.shape)).astype(np.float32), 2, rng)
    back = decode(encode(few.astype(np.float32), books), books)
    assert np.median(np.abs(back - few)) < 0.01
    assert np.isfinite(books.parts).all()


@pytest.mark.parametrize("parts", [0, 3, 16, -1])
def test_parts_that_do_not_divide_are_refused(parts: int) -> None:
    with pytest.raises(InputError, match="expected a divisor of 8"):
        learn_codebooks(np.ones((4, 8), np.float32), parts, np.random.default_rng(0))


def test_nothing_to_learn_from_is_refused() -> None:
    with pytest.raises(InputError, match="expected one that is not zero"):
        learn_codebooks(np.zeros((4, 8), np.float32), 4, np.random.default_rng(0))
