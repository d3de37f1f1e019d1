# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops over pairs of things of one view: the gaps of one thing to all others, and who holds, covers or hides whom.

The rules and their constants are those of `relations`, which is where they are explained.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numba.extending import intrinsic

from pipeline.cached_kernels import kernel


@intrinsic
def _fma(typing, a, b, c):
    """Return a * b + c, rounded once, as the matrix products of NumPy's libraries do on current processors."""
    return a(a, b, c), lambda _context, builder, _signature, values: builder.fma(*values)


@kernel
def gaps_of(thing, low, high, x, y, z, squared, begins, near_m, spacing_m):
    """Return the gaps (T,) float64 of a thing to all.

    Takes its index, boxes (T, 3) float64, coordinates and squared lengths (K,) float32 of all points with begins
    (T + 1,) int64, the box gap from which on points do not count, and how far points lie inside an edge.
    """
    count = len(low)
    gaps = np.empty(count)
    begin, end = begins[thing], begins[thing + 1]
    nearest = np.full(len(squared), np.float32(np.inf))
    two = np.float32(2.0)
    for at in range(begin, end):
        _come_nearer(nearest, two * x[at], two * y[at], two * z[at], squared[at], x, y, z, squared)
    for other in range(count):
        apart = np.maximum(0.0, np.maximum(low[thing] - high[other], low[other] - high[thing]))
        gaps[other] = math.sqrt(_fma(apart[2], apart[2], _fma(apart[1], apart[1], apart[0] * apart[0])))
        if gaps[other] > near_m or begin == end or begins[other] == begins[other + 1]:
            continue
        least = np.float32(np.inf)
        for at in range(begins[other], begins[other + 1]):
            least = min(least, nearest[at])
        gaps[other] = max(gaps[other], math.sqrt(max(0.0, np.float64(least))) - spacing_m)
    return gaps


@njit
def _come_nearer(nearest, twice_x, twice_y, twice_z, own, x, y, z, squared):
    """Lower squared distances where a point is nearer; over all points at once, so that many are done at a time."""
    for at in range(len(nearest)):
        product = _fma(twice_z, z[at], _fma(twice_y, y[at], twice_x * x[at]))
        distance = (own + squared[at]) - product
        nearest[at] = distance if distance < nearest[at] else nearest[at]


@kernel
def stand(low, high, points, begins, reach, kinds, contacts, rules):
    """Return which relations hold, (6, T, T) bool: on, in, under, above, behind, and whether two stand side by side.

    Takes boxes (T, 3) float64, points (3, K) float32 with begins (T + 1,) int64, the squared reach (T,) float64 about
    the upright line through the middle of each, kinds (5, T) bool (building, ground, upright, standing on the floor,
    container), contacts (T, T) float64 and the constants of `relations` as in `Pairs`.
    """
    rest_m, rest_share, small, edge_m, next_to_m, under_m, behind_m, step_m, above_m, hanging_m = rules
    building, ground, upright, standing, container = kinds
    count = len(low)
    found = np.zeros((6, count, count), np.bool_)
    on, inside, under, above, behind, beside = found
    size, middle = high - low, 0.5 * (low + high)
    bottom = low[:, 1].min() if count else 0.0
    for a in range(count):
        for b in range(count):
            over = _over(middle[a], low[b], high[b], edge_m)
            met, level, covered = _about_axis(
                middle[a],
                reach[a],
                low[b],
                high[b],
                points[:, begins[b] : begins[b + 1]],
                low[a, 1],
                high[a, 1],
                rest_m,
            )
            if container[b] and not building[a] and not standing[a]:
                fits = size[a, 0] <= size[b, 0] + edge_m and size[a, 1] <= size[b, 1] + edge_m
                below_top = middle[a, 1] < high[b, 1] and low[a, 1] < high[b, 1] - 0.03
                above_foot = low[a, 1] > low[b, 1] - 2 * edge_m
                inside[a, b] = fits and below_top and above_foot and over and met
            covers = covered and over
            under[a, b] = (
                covers
                and not (building[a] or building[b] or contacts[a, b] >= rest_share)
                and high[a, 1] < high[b, 1] - step_m
                and middle[a, 1] < middle[b, 1]
                and low[a, 1] <= low[b, 1] + rest_m
                and low[b, 1] - high[a, 1] <= under_m
                and size[a, 0] <= size[b, 0] + edge_m
                and size[a, 2] <= size[b, 2] + edge_m
            )
            vertical = max(low[a, 1] - high[b, 1], low[b, 1] - high[a, 1])
            beside[a, b] = not (
                vertical > next_to_m or _over(middle[a], low[b], high[b], 0.0) or _over(middle[b], low[a], high[a], 0.0)
            )
            if building[a] or (upright[a] and not upright[b]) or (standing[a] and not ground[b]):
                continue
            if upright[b]:
                touches = contacts[a, b] + contacts[b, a] > 0
                if touches and low[a, 1] - bottom > hanging_m:
                    resting = False
                    for lower in range(count):
                        resting |= lower != b and contacts[a, lower] >= rest_share
                    on[a, b] = not resting and size[a].min() < 0.5 and size[b, 1] > size[a, 1]
            elif high[b, 1] < low[a, 1] - rest_m or low[a, 1] < low[b, 1] - step_m:
                continue
            elif ground[b]:
                on[a, b] = low[a, 1] - high[b, 1] <= rest_m and contacts[a, b] > 0
            elif size[a, 0] <= 1.5 * size[b, 0] + edge_m and size[a, 2] <= 1.5 * size[b, 2] + edge_m:
                volume, volume_b = size[a, 0] * size[a, 1] * size[a, 2], size[b, 0] * size[b, 1] * size[b, 2]
                higher = middle[a, 1] > middle[b, 1] or volume < small * volume_b
                on[a, b] = higher and (contacts[a, b] >= rest_share or level)
    for a in range(count):
        for b in range(count):
            under[a, b] = under[a, b] and not (inside[a, b] or on[b, a] or on[a, b])
            side = max(0.0, low[a, 0] - high[b, 0], low[b, 0] - high[a, 0])
            ahead = max(0.0, low[a, 2] - high[b, 2], low[b, 2] - high[a, 2])
            gap = low[a, 1] - high[b, 1]
            above[a, b] = -step_m <= gap <= above_m and not on[a, b] and side <= edge_m and ahead <= next_to_m
            behind[a, b] = (
                not (middle[a, 2] < middle[b, 2] + step_m or low[a, 2] < low[b, 2] + step_m)
                and not (side > edge_m or ahead > behind_m or on[a, b] or inside[a, b])
                and not (under[a, b] or low[a, 1] > high[b, 1] + step_m)
            )
    return found


@njit
def _over(middle, low, high, margin):
    """Whether a middle is over a footprint, seen from above."""
    return (
        low[0] - margin <= middle[0]
        and middle[0] <= high[0] + margin
        and low[2] - margin <= middle[2]
        and middle[2] <= high[2] + margin
    )


@njit
def _about_axis(middle, reach, low, high, points, foot, top, rest_m):
    """Whether any points lie about the upright line through a middle, any at the height of its foot, any over its top.

    `reach` is squared.
    """
    off_x = max(0.0, low[0] - middle[0], middle[0] - high[0]) - 1e-3
    off_z = max(0.0, low[2] - middle[2], middle[2] - high[2]) - 1e-3
    met, level, covered = False, False, False
    if (off_x > 0 and off_x * off_x > reach) or (off_z > 0 and off_z * off_z > reach):
        return met, level, covered  # points lie in the box
    for at in range(points.shape[1]):
        x, y, z = np.float64(points[0, at]), np.float64(points[1, at]), np.float64(points[2, at])
        near = (x - middle[0]) * (x - middle[0]) + (z - middle[2]) * (z - middle[2]) <= reach
        met |= near
        level |= near and abs(y - foot) <= rest_m
        covered |= near and y > top
    return met, level, covered
