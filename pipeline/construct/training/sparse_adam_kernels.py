# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Compiled Adam on some rows of a table. Work is split over ranges of the rows; rows do not touch each other."""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel

ONE = np.float32(1.0)


@kernel
def adam_rows(first, last, ids, shown, updates, rates, gradient, values, mean, square, beta1, beta2, epsilon):
    """Move values[ids[k]] for k from first to last, where shown[k], by one step of Adam.

    Takes ids (n,) int64 without repeats, shown (n,) bool, updates (M,) int32, the step each row is at, rates (c,),
    gradient (n, C), values, mean, square (M, C), and beta1, beta2, epsilon; numbers are float32. Numbers of a row
    from c on are left.
    """
    for k in range(first, last):
        if not shown[k]:
            continue
        row = ids[k]
        done = np.float32(updates[row])
        unbias_mean = ONE / (ONE - beta1**done)
        unbias_square = ONE / (ONE - beta2**done)
        for c in range(len(rates)):
            slope = gradient[k, c]
            m = beta1 * mean[row, c] + (ONE - beta1) * slope
            s = beta2 * square[row, c] + (ONE - beta2) * slope * slope
            mean[row, c] = m
            square[row, c] = s
            values[row, c] -= rates[c] * m * unbias_mean / (np.sqrt(s * unbias_square) + epsilon)
