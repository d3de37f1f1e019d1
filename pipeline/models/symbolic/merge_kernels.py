# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops of `merge`: pairs of parts of one name, compared until they are known to be one thing."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel


@kernel
def merge(category, labels, sample_pixel, begins, depth, low, high, mergeable, rules):
    """Return the object of each part, (P,) int64: the index of its largest part.

    Takes category (P,) int64, labels (H, W) int32, sample_pixel (S,) and begins (P + 1,) int64, depth (H, W) float32,
    low, high (P, 3) float64, mergeable (P,) bool and the constants of `merge.py` in their order there, with those of
    `jump_limit` after them.
    """
    hidden_gap_m, upright_gap_m, upright_overlap, stands_out_m, within_m = rules[:5]
    count = len(category)
    owner = np.arange(count)
    for first in range(count):
        if not mergeable[first]:
            continue
        for second in range(first + 1, count):
            if category[second] != category[first] or owner[second] == owner[first]:
                continue
            one, two = (low[first], high[first]), (low[second], high[second])
            gap = np.maximum(0.0, np.maximum(one[0] - two[1], two[0] - one[1]))
            if (
                _one_upright_thing(one, two, gap, upright_gap_m, upright_overlap, stands_out_m)
                or _middle_within(one, two, within_m)
                or _middle_within(two, one, within_m)
                or (
                    math.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]) <= hidden_gap_m
                    and _cut_by_something(labels, sample_pixel, begins, depth, mergeable, first, second, rules[5:])
                )
            ):
                old, new = max(owner[first], owner[second]), min(owner[first], owner[second])
                for part in range(count):
                    if owner[part] == old:
                        owner[part] = new
    return owner


@njit
def _one_upright_thing(one, two, gap, upright_gap_m, upright_overlap, stands_out_m):
    if gap[1] > upright_gap_m or gap[0] > 0 or gap[2] > stands_out_m:
        return False
    (low, high), (low_2, high_2) = one, two
    shorter = min(high[1] - low[1], high_2[1] - low_2[1])
    stacked = max(low[1], low_2[1]) > min(high[1], high_2[1]) - 0.25 * shorter
    overlap = min(high[0], high_2[0]) - max(low[0], low_2[0])
    narrow = min(high[0] - low[0], high_2[0] - low_2[0])
    return stacked and overlap >= upright_overlap * narrow


@njit
def _middle_within(one, two, within_m):
    (low, high), (low_2, high_2) = one, two
    for axis in range(3):
        middle = 0.5 * (low[axis] + high[axis])
        if not (middle >= low_2[axis] - within_m and middle <= high_2[axis] + within_m):
            return False
    return True


@njit
def _cut_by_something(labels, sample_pixel, begins, depth, mergeable, first, second, rules):
    """Walk from one part to the other where they are closest and ask what lies between, see `merge.py`."""
    occluded_share, nearest, probes, jump_m, jump_per_m = rules
    start, stop = _closest(sample_pixel, begins, first, second, nearest, depth.shape[1])
    row_0, column_0 = start // depth.shape[1], start % depth.shape[1]
    rows, columns = stop // depth.shape[1] - row_0, stop % depth.shape[1] - column_0
    z_0, z_1 = np.float64(depth[row_0, column_0]), np.float64(depth[row_0 + rows, column_0 + columns])
    between, before = 0, 0
    for probe in range(probes):
        fraction = (probe + 0.5) / probes
        row, column = round(row_0 + fraction * rows), round(column_0 + fraction * columns)
        met = labels[row, column]
        if met in (first, second):
            continue
        between += 1
        expected = z_0 * (1.0 - fraction) + z_1 * fraction
        margin = (-0.5 if met < 0 or not mergeable[met] else 0.5) * (jump_m + jump_per_m * expected)
        before += 0 < depth[row, column] < expected + margin
    return between > 0 and before / between > occluded_share


@njit
def _closest(sample_pixel, begins, first, second, nearest, width):
    """Pixels of two parts that are closest in the image, the earliest of equals, among about `nearest` of each."""
    best, start, stop = np.int64(2) ** 62, np.int64(0), np.int64(0)
    step = max(1, (begins[first + 1] - begins[first]) // nearest)
    step_2 = max(1, (begins[second + 1] - begins[second]) // nearest)
    for a in range(begins[first], begins[first + 1], step):
        row, column = sample_pixel[a] // width, sample_pixel[a] % width
        for b in range(begins[second], begins[second + 1], step_2):
            rows, columns = sample_pixel[b] // width - row, sample_pixel[b] % width - column
            if rows * rows + columns * columns < best:
                best, start, stop = rows * rows + columns * columns, sample_pixel[a], sample_pixel[b]
    return start, stop
