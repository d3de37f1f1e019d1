from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.metrics.count_error import CountError, count_error

COUNTS = st.lists(st.tuples(st.integers(0, 12), st.integers(0, 12)), min_size=1, max_size=40)


@given(COUNTS)
def test_count_error_equals_numpy_on_the_differences(pairs: list[tuple[int, int]]) -> None:
    predicted, targets = zip(*pairs, strict=True)
    difference = np.subtract(predicted, targets)
    found = count_error(predicted, targets)
    assert found.questions == len(pairs)
    assert found.mean_absolute == pytest.approx(np.abs(difference).mean())
    assert found.bias == pytest.approx(difference.mean())
    assert found.exact == pytest.approx((difference == 0).mean())


@given(COUNTS)
def test_bias_never_exceeds_the_mean_absolute_error(pairs: list[tuple[int, int]]) -> None:
    found = count_error(*zip(*pairs, strict=True))
    assert abs(found.bias) <= found.mean_absolute + 1e-12


def test_too_many_and_too_few_cancel_in_the_bias_alone() -> None:
    assert count_error([3, 1], [2, 2]) == CountError(2, 1.0, 0.0, 0.0)


def test_one_question_without_a_target_gives_its_own_error() -> None:
    assert count_error([0], [0]) == CountError(1, 0.0, 0.0, 1.0)
    assert count_error([2], [0]) == CountError(1, 2.0, 2.0, 0.0)


def test_no_question_has_no_error() -> None:
    found = count_error([], [])
    assert found.questions == 0
    assert all(map(math.isnan, (found.mean_absolute, found.bias, found.exact)))


def test_counts_of_other_questions_are_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        count_error([1, 2], [1])
