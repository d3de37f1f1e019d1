"""Repeated runs of one method: their mean and spread, and the paired test of two methods by question.

The paper's stability table gives mean +- standard deviation over three runs and "a paired significance test at the
question level" without naming it. Here each question has the mean of its scores over a method's runs, and the test is
Student's paired t test over questions: our reading. `permutation_p` tests the same without its assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class OverRuns:
    """One score over repeated runs."""

    mean: float | None
    """Mean over runs; None for no run."""
    std: float | None
    """Sample standard deviation (divided by runs - 1); None for fewer than two runs."""
    runs: int
    """Runs."""


@dataclass(frozen=True, slots=True)
class PairedTest:
    """Student's paired t test of equal means, two-sided."""

    difference: float | None
    """Mean of second - first; None for no pair."""
    p: float | None
    """0 to 1; None for fewer than two pairs. 1 where no pair differs, 0 where all differ by the same."""
    pairs: int
    """Questions scored by both."""


def over_runs(scores: Sequence[float]) -> OverRuns:
    """Return mean and sample standard deviation of the scores of runs, finite numbers."""
    mean = math.fsum(scores) / len(scores) if scores else None
    std = float(np.std(np.asarray(scores, np.float64), ddof=1)) if len(scores) > 1 else None
    return OverRuns(mean, std, len(scores))


def mean_by_question(runs: Float[np.ndarray, "R n"]) -> Float[np.ndarray, "n"]:
    """Return each question's mean over the runs that scored it; NaN where none did.

    Args:
        runs: One row a run, one column a question, NaN where unscored.
    """
    scored = np.isfinite(runs)
    counts = scored.sum(axis=0)
    totals = np.where(scored, runs, 0.0).sum(axis=0)
    return np.divide(totals, counts, out=np.full(runs.shape[1], np.nan), where=counts > 0)


def paired_t(first: Float[np.ndarray, "n"], second: Float[np.ndarray, "n"]) -> PairedTest:
    """Return the paired t test over the questions that both scored.

    Args:
        first: One score a question, NaN where unscored.
        second: The other method's, in the same order.
    """
    from scipy.special import stdtr  # a quarter of a second, which no command line should pay at its start

    difference = np.asarray(second, np.float64) - np.asarray(first, np.float64)
    difference = difference[np.isfinite(difference)]
    n = len(difference)
    if n < 2:
        return PairedTest(float(difference[0]) if n else None, None, n)
    mean, spread = float(difference.mean()), float(difference.std(ddof=1))
    if np.ptp(difference) == 0.0:
        return PairedTest(mean, 1.0 if mean == 0.0 else 0.0, n)
    return PairedTest(mean, float(2.0 * stdtr(n - 1, -abs(mean) / (spread / math.sqrt(n)))), n)
