"""Mean and spread over runs, and the paired t test, against SciPy and the standard library."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.metrics.stability import OverRuns, PairedTest, mean_by_question, over_runs, paired_t

MARKS = st.sampled_from([0.0, 25.0, 50.0, 75.0, 100.0])


@given(st.lists(st.floats(0, 100), min_size=2, max_size=6))
def test_over_runs_equals_the_standard_library(scores: list[float]) -> None:
    found = over_runs(scores)
    assert found.mean == pytest.approx(statistics.fmean(scores))
    assert found.std == pytest.approx(statistics.stdev(scores), abs=1e-9)


def test_over_runs_of_three_divides_by_two() -> None:
    assert over_runs([1.0, 2.0, 3.0]) == OverRuns(2.0, 1.0, 3)


def test_over_runs_of_none_and_one_has_no_spread() -> None:
    assert over_runs([]) == OverRuns(None, None, 0)
    assert over_runs([4.0]) == OverRuns(4.0, None, 1)


@settings(deadline=None)  # the first call imports SciPy
@given(st.lists(st.tuples(MARKS, MARKS), min_size=2, max_size=40))
def test_paired_t_equals_scipy(pairs: list[tuple[float, float]]) -> None:
    first, second = np.array(pairs).T
    found = paired_t(first, second)
    assert found.difference == pytest.approx((second - first).mean())
    if np.ptp(second - first) > 0:
        assert found.p == pytest.approx(stats.ttest_rel(second, first).pvalue, rel=1e-9)
        assert paired_t(second, first).p == pytest.approx(found.p)


def test_paired_t_leaves_out_questions_that_one_did_not_score() -> None:
    first, second = np.array([0.0, np.nan, 50, 25, 75]), np.array([25.0, 100, np.nan, 50, 50])
    kept = np.array([0, 3, 4])
    found = paired_t(first, second)
    assert found.pairs == 3
    assert found.p == pytest.approx(stats.ttest_rel(second[kept], first[kept]).pvalue)


def test_paired_t_of_no_question_one_and_constant_differences() -> None:
    nothing = np.empty(0)
    assert paired_t(nothing, nothing) == PairedTest(None, None, 0)
    assert paired_t(np.array([1.0]), np.array([3.0])) == PairedTest(2.0, None, 1)
    assert paired_t(np.ones(5), np.ones(5)) == PairedTest(0.0, 1.0, 5)
    assert paired_t(np.zeros(5), np.ones(5)) == PairedTest(1.0, 0.0, 5)


def test_mean_by_question_averages_the_runs_that_scored_it() -> None:
    runs = np.array([[0.0, np.nan, np.nan], [100.0, 50.0, np.nan], [50.0, np.nan, np.nan]])
    np.testing.assert_array_equal(mean_by_question(runs), [50.0, 50.0, np.nan])
    np.testing.assert_array_equal(mean_by_question(np.empty((0, 2))), [np.nan, np.nan])
