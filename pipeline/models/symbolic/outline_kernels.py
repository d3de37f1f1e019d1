# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops over the pixels where one thing ends and another begins: who touches or covers whom, what stands open."""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel


@kernel
def outlines(run_begin, row_begin, run_part, rank, depth, count, jump_m, jump_per_m):
    """Return who touches and who covers whom, with the pixels of the outlines they are shares of.

    Takes run_begin (R + 1,), row_begin (H + 1,) and run_part (R,) int32 of `Parts`, rank (P + 1,) int32, the thing of
    each part or -1, depth (H, W) float32 and two float32. Returns touching (T, T) int32 [upper, lower], lower outline
    (T,) int64, covering (T, T) int32 [front, back] and outline (T,) int64.
    """
    height, width = depth.shape
    touching, covering = np.zeros((count, count), np.int32), np.zeros((count, count), np.int32)
    feet, outline = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for row in range(height):
        z = depth[row]
        for run in range(row_begin[row] + 1, row_begin[row + 1]):
            one, two = rank[run_part[run - 1]], rank[run_part[run]]
            if one != two:
                column = run_begin[run] - row * width - 1
                limit = jump_m + jump_per_m * z[column]
                _cover(one, two, z[column + 1] - z[column], limit, covering, outline)
        if row + 1 == height:
            break
        z_below = depth[row + 1]
        upper, lower = row_begin[row], row_begin[row + 1]
        while upper < row_begin[row + 1] and lower < row_begin[row + 2]:
            upper_end, lower_end = run_begin[upper + 1], run_begin[lower + 1] - width
            one, two = rank[run_part[upper]], rank[run_part[lower]]
            if one != two:
                begin = max(run_begin[upper], run_begin[lower] - width) - row * width
                for column in range(begin, min(upper_end, lower_end) - row * width):
                    step, limit = z_below[column] - z[column], jump_m + jump_per_m * z[column]
                    _cover(one, two, step, limit, covering, outline)
                    if one >= 0:
                        feet[one] += 1
                        if two >= 0 and abs(step) <= limit:
                            touching[one, two] += 1
            upper += upper_end <= lower_end
            lower += lower_end <= upper_end
    return touching, feet, covering, outline


@njit
def _cover(one, two, step, limit, covering, outline):
    """Count a border: `step` is how much farther the second pixel lies."""
    if one >= 0:
        outline[one] += 1
        if two >= 0 and -step > limit:
            covering[two, one] += 1
    if two >= 0:
        outline[two] += 1
        if one >= 0 and step > limit:
            covering[one, two] += 1


@kernel
def cut_out(labels, rank, thing, depth, bounds):
    """Return a thing's mask and depth within bounds (4,) int64 and a pixel around: (h, w) bool and float32."""
    left, top = max(0, bounds[0] - 1), max(0, bounds[1] - 1)
    right, bottom = min(labels.shape[1], bounds[2] + 2), min(labels.shape[0], bounds[3] + 2)
    mask = np.empty((bottom - top, right - left), np.bool_)
    for row in range(bottom - top):
        for column in range(right - left):
            mask[row, column] = rank[labels[top + row, left + column]] == thing
    return mask, depth[top:bottom, left:right].copy()


@kernel
def free_edge(mask, depth, inward, jump_m, jump_per_m):
    """Return of the left (inward 1) or right (-1) edge of a thing: pixels that are free, pixels seen, rows it has.

    See `shapes`; takes (h, w) bool and float32.
    """
    free, seen, rows = 0, 0, 0
    for row in range(mask.shape[0]):
        own, z = mask[row], depth[row]
        any_own = False
        for column in range(len(own)):
            any_own |= own[column]
            outer = column - inward
            if own[column] and 0 <= outer < len(own) and not own[outer] and z[outer] > 0:
                step, limit = z[outer] - z[column], jump_m + jump_per_m * z[column]
                seen += step > -limit
                free += step > np.float32(2.0) * limit
        rows += any_own
    return free, seen, rows


@kernel
def hollow_rows(mask, depth, rim, dent_m, dent_per_m):
    """Return the share of pixels behind the line across their row, see `shapes`; takes (a, b) bool and float32."""
    behind, seen = 0, 0
    for row in range(mask.shape[0]):
        own, z = mask[row], depth[row]
        count, first, last = 0, -1, -1
        for column in range(len(own)):
            if own[column]:
                first = column if count == 0 else first
                last = column
                count += 1
        if count < 4 * rim:
            continue
        seen += count
        start = stop = np.float32(0.0)
        for reach in range(1, rim):
            if own[first + reach]:
                start = max(start, z[first + reach])
            if own[last - reach]:
                stop = max(stop, z[last - reach])
        near, far = _inverse(start), _inverse(stop)
        for column in range(first, last + 1):
            if own[column]:
                along = (column - first) / max(1, last - first)
                chord = 1.0 / max(1e-6, near * (1.0 - along) + far * along)
                behind += z[column] > chord + dent_m + np.float32(dent_per_m) * z[column]
    return behind / seen if seen else 0.0


@njit
def _inverse(depth_m):
    return np.float64(np.float32(1.0) / max(depth_m, np.float32(1e-6)))
