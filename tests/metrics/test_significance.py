"""Intervals and tests: coverage on known truths, laws, and what zero or one sample gives."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.significance import Interval, bootstrap_interval, permutation_p

FINITE = st.floats(-100, 100)


def _rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_bootstrap_interval_of_no_value_and_of_one() -> None:
    assert bootstrap_interval(np.array([]), [], _rng()) == Interval(None, None, None, 0, 0, False)
    assert bootstrap_interval(np.array([3.0]), ["a"], _rng()) == Interval(3.0, None, None, 1, 1, False)


def test_bootstrap_interval_one_scene_draws_questions() -> None:
    values = _rng(1).normal(size=50)
    interval = bootstrap_interval(values, ["a"] * 50, _rng())
    assert not interval.by_scene
    assert not interval.few_scenes
    assert interval == bootstrap_interval(values, ["a"] * 50, _rng(), by_scene=False)


def test_bootstrap_interval_few_scenes_are_marked() -> None:
    scenes = [str(i % 3) for i in range(30)]
    values = np.arange(30.0)
    assert bootstrap_interval(values, scenes, _rng()).few_scenes
    assert not bootstrap_interval(values, scenes, _rng(), by_scene=False).few_scenes
    assert not bootstrap_interval(values, [str(i % 10) for i in range(30)], _rng()).few_scenes


@settings(max_examples=50)
@given(st.lists(st.tuples(FINITE, st.sampled_from("abcde")), min_size=2, max_size=60), st.booleans())
def test_bootstrap_interval_lies_within_the_values(data: list[tuple[float, str]], by_scene: bool) -> None:
    values = np.array([value for value, _ in data])
    scenes = [scene for _, scene in data]
    interval = bootstrap_interval(values, scenes, _rng(), by_scene=by_scene, resamples=200)
    assert interval.mean == pytest.approx(values.mean())
    assert interval.low is not None
    assert interval.high is not None
    assert values.min() - 1e-9 <= interval.low <= interval.high <= values.max() + 1e-9
    assert interval == bootstrap_interval(values, scenes, _rng(), by_scene=by_scene, resamples=200)


@pytest.mark.parametrize("by_scene", [True, False])
def test_bootstrap_interval_matches_a_plain_loop(by_scene: bool) -> None:
    """The vectorised draws against the definition, written out."""
    data = _rng(3)
    scenes = np.array(list("aaaaabbbbbbbbccdddd"))
    values = data.normal(size=len(scenes)) + (scenes == "a") * 3
    loop, means = _rng(4), []
    for _ in range(4_000):
        drawn = []
        if by_scene:
            for scene in loop.choice(list("abcd"), 4):
                own = values[scenes == scene]
                drawn.append(loop.choice(own, len(own)))
        else:
            drawn.append(loop.choice(values, len(values)))
        means.append(np.concatenate(drawn).mean())
    interval = bootstrap_interval(values, list(scenes), _rng(5), by_scene=by_scene, resamples=4_000)
    # Ends of two independent sets of 4,000 draws differ by about 2 % of the width.
    width = np.quantile(means, 0.975) - np.quantile(means, 0.025)
    assert interval.low == pytest.approx(np.quantile(means, 0.025), abs=0.08 * width)
    assert interval.high == pytest.approx(np.quantile(means, 0.975), abs=0.08 * width)


def test_bootstrap_interval_covers_the_truth_where_scenes_differ_and_the_plain_one_does_not() -> None:
    """30 scenes with an effect of their own: 95 % intervals must cover near 95 % of the time (200 trials)."""
    data, covered = _rng(6), {True: 0, False: 0}
    scenes = [str(i) for i in range(30) for _ in range(10)]
    for _ in range(200):
        values = np.repeat(data.normal(size=30), 10) + 0.5 * data.normal(size=300)
        for by_scene in covered:
            interval = bootstrap_interval(values, scenes, data, by_scene=by_scene, resamples=300)
            assert interval.low is not None
            assert interval.high is not None
            covered[by_scene] += interval.low <= 0 <= interval.high
    assert covered[True] >= 178
    assert covered[False] <= 140


def test_bootstrap_interval_of_paired_differences_sees_what_separate_intervals_miss() -> None:
    data = _rng(7)
    first = data.normal(0, 30, 300)
    second = first + 2 + data.normal(size=300)
    scenes = [str(i % 20) for i in range(300)]
    paired = bootstrap_interval(second - first, scenes, _rng())
    apart = [bootstrap_interval(arm, scenes, _rng()) for arm in (first, second)]
    assert paired.low is not None
    assert paired.low > 0
    assert (apart[0].high or 0) > (apart[1].low or 0)


def test_bootstrap_interval_unequal_lengths_raise() -> None:
    with pytest.raises(ValueError, match="3 and 2"):
        bootstrap_interval(np.zeros(3), ["a", "b"], _rng())


def test_permutation_p_of_nothing_one_and_equal_pairs() -> None:
    assert permutation_p(np.array([]), np.array([]), _rng()) is None
    assert permutation_p(np.array([np.nan]), np.ones(1), _rng()) is None
    assert permutation_p(np.zeros(1), np.ones(1), _rng()) == 1.0
    assert permutation_p(np.arange(2.0), np.arange(2.0), _rng()) == 1.0


@settings(max_examples=40)
@given(st.lists(st.integers(-5, 5), min_size=1, max_size=8))
def test_permutation_p_small_samples_are_exact(differences: list[int]) -> None:
    sums = [
        abs(sum(s * d for s, d in zip(signs, differences, strict=True)))
        for signs in itertools.product((1, -1), repeat=len(differences))
    ]
    expected = np.mean([total >= abs(sum(differences)) for total in sums])
    p = permutation_p(np.zeros(len(differences)), np.array(differences, np.float64), _rng())
    assert p == pytest.approx(expected)


def test_permutation_p_random_flips_agree_with_the_normal_law() -> None:
    differences = _rng(8).normal(0.15, 1, 200)
    z = differences.sum() / np.sqrt((differences**2).sum())
    p = permutation_p(np.zeros(200), differences, _rng(9))
    from scipy.stats import norm

    assert p == pytest.approx(2 * norm.sf(abs(z)), abs=0.012)
    assert p == permutation_p(np.zeros(200), differences, _rng(9))


def test_permutation_p_symmetric_and_never_zero() -> None:
    first, second = np.zeros(50), np.ones(50)
    p = permutation_p(first, second, _rng(), resamples=999)
    assert p == permutation_p(second, first, _rng(), resamples=999) == 0.001


def test_permutation_p_by_scene_is_bounded_by_the_number_of_scenes() -> None:
    scenes = [str(i % 3) for i in range(30)]
    assert permutation_p(np.zeros(30), np.ones(30), _rng(), scenes=scenes) == 0.25


def test_permutation_p_is_uniform_under_the_null() -> None:
    data = _rng(10)
    small = sum(
        (permutation_p(np.zeros(20), data.normal(size=20), data, resamples=199) or 0) <= 0.1 for _ in range(300)
    )
    # Binomial(300, 0.1): 30 with a standard deviation of 5.2.
    assert 10 <= small <= 50
