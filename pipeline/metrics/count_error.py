"""How far the number of predicted instances is from the number of targets (the paper's named failure, supplement C)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CountError:
    """Errors of counts over questions; without a question the means are NaN."""

    questions: int
    """Questions with both counts."""
    mean_absolute: float
    """Mean of |predicted - targets|, instances."""
    bias: float
    """Mean of predicted - targets, instances: below 0 too few are found."""
    exact: float
    """Share of questions with as many as there are, 0 to 1."""


def count_error(predicted: Sequence[int], targets: Sequence[int]) -> CountError:
    """Return how far predicted counts are from the true ones; one question gives its own error.

    Args:
        predicted: Instances predicted, one number a question, 0 or more.
        targets: Instances there are, in the same order; questions without a target count like all others.

    Raises:
        ValueError: The two differ in length.
    """
    errors = [found - wanted for found, wanted in zip(predicted, targets, strict=True)]
    if not errors:
        return CountError(0, math.nan, math.nan, math.nan)
    return CountError(
        len(errors),
        sum(map(abs, errors)) / len(errors),
        sum(errors) / len(errors),
        errors.count(0) / len(errors),
    )
