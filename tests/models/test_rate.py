"""Rates: no minute ever holds more than its limit, and little of the limit is left unused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.rate import RateWindow

SLACK_S = 0.5


def most_in_a_minute(times: list[float], amounts: list[int]) -> int:
    """Brute force: the largest sum over any half-open minute that starts with a call."""
    return max(sum(a for t, a in zip(times, amounts, strict=True) if s <= t < s + 60.0) for s in times)


@given(
    limit=st.integers(1, 30),
    gaps=st.lists(st.floats(0, 20), min_size=1, max_size=120),
)
def test_requests_never_exceed_the_limit_in_any_minute(limit: int, gaps: list[float]) -> None:
    window, now, times = RateWindow(limit, None), 0.0, list[float]()
    for gap in gaps:
        now += gap
        now += window.wait_s(0, now)
        assert window.wait_s(0, now) == 0
        window.admit(0, now)
        times.append(now)
    assert most_in_a_minute(times, [1] * len(times)) <= limit


@given(
    limit=st.integers(10, 1000),
    calls=st.lists(st.tuples(st.floats(0, 20), st.integers(0, 400), st.floats(0, 1)), min_size=1, max_size=80),
)
def test_tokens_never_exceed_the_limit_when_usage_stays_below_its_estimate(
    limit: int, calls: list[tuple[float, int, float]]
) -> None:
    window, now = RateWindow(None, limit), 0.0
    times, used = list[float](), list[int]()
    for gap, tokens, share in calls:
        estimate = min(tokens, limit)
        now += gap
        now += window.wait_s(estimate, now)
        call = window.admit(estimate, now)
        window.settle(call, int(estimate * share))
        times.append(now)
        used.append(int(estimate * share))
    assert most_in_a_minute(times, used) <= limit


@pytest.mark.parametrize("limit", [1, 3, 50, 600])
def test_a_busy_minute_uses_nineteen_twentieths_of_the_limit(limit: int) -> None:
    window, now = RateWindow(limit, None), 0.0
    calls = limit * 20
    for _ in range(calls):
        now += window.wait_s(0, now)
        window.admit(0, now)
    assert calls / (now + 60) * 60 >= 0.95 * limit * 20 / 21  # the first call is at 0


def test_requests_are_spread_over_the_minute() -> None:
    window, now, times = RateWindow(120, None, burst_s=5.0), 0.0, list[float]()
    for _ in range(120):
        now += window.wait_s(0, now)
        window.admit(0, now)
        times.append(now)
    assert max(np.searchsorted(times, t + 5) - i for i, t in enumerate(times)) <= 10
    assert all(b >= a for a, b in pairwise(times))


def test_what_a_call_did_not_use_is_free_for_the_next() -> None:
    window = RateWindow(None, 1000)
    call = window.admit(1000, 0.0)
    assert window.wait_s(500, 1.0) == pytest.approx(59.0 + SLACK_S)
    window.settle(call, 400)
    assert window.wait_s(500, 1.0) == 0


def test_a_call_that_used_more_than_its_estimate_makes_the_next_wait() -> None:
    window = RateWindow(None, 1000)
    window.settle(window.admit(100, 0.0), 900)
    assert window.wait_s(200, 1.0) > 0


def test_a_call_above_the_whole_limit_goes_alone() -> None:
    window = RateWindow(None, 1000)
    assert window.wait_s(5000, 0.0) == 0
    window.admit(5000, 0.0)
    assert window.wait_s(1, 1.0) == pytest.approx(59.0 + SLACK_S)


def test_settling_a_call_that_has_left_the_window_changes_nothing() -> None:
    window = RateWindow(None, 1000)
    old = window.admit(1000, 0.0)
    assert window.wait_s(1000, 61.0) == 0
    window.admit(1000, 61.0)
    window.settle(old, 0)
    assert window.wait_s(1, 61.0) > 0
