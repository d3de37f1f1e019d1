# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops of the ground-truth distillation: a k-d tree over the points, and each Gaussian's vote over its nearest ones.

A tree and not a grid: a Gaussian of metres, a far-away point or a dense clump costs no more than its own candidates,
with no cell size to choose. The tree is implicit. A node holds the points [start, end), its children 2k+1 and 2k+2 the
two halves, and every node its tight box. Bounds compare the same sums in the same order as distances do, so what is
pruned is exactly what is too far. Candidates are ranked by (distance, index of the point), so neither the shape of the
tree nor the thread that runs a chunk changes a label.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

NEGLIGIBLE = 100.0
"""Squared Mahalanobis distance beyond the nearest candidate's: exp(-50) is lost in the rounding of any sum here."""
TIE = 1e-9
"""Labels whose weights differ by less than this share are tied: far above the rounding of a sum in another order."""
DEEPEST = 64
"""Nodes that wait while one is looked at: one a level, and 2^31 points have fewer levels."""


@kernel
def build_tree(
    points,  # (P, 3) float64, reordered in place
    order,  # (P,) int32, reordered alike
    levels,  # splits from the root to a leaf
    low,  # (nodes, 3) float64, out
    high,  # (nodes, 3) float64, out
):
    """Sort the points into a k-d tree and write every node's box."""
    nodes, starts, ends = np.empty(DEEPEST, np.int64), np.empty(DEEPEST, np.int64), np.empty(DEEPEST, np.int64)
    depths = np.empty(DEEPEST, np.int64)
    nodes[0], starts[0], ends[0], depths[0] = 0, 0, len(points), 0
    top = 1
    while top:
        top -= 1
        node, start, end, depth = nodes[top], starts[top], ends[top], depths[top]
        axis, widest = 0, -1.0
        for a in range(3):
            least, most = math.inf, -math.inf
            for i in range(start, end):
                least, most = min(least, points[i, a]), max(most, points[i, a])
            low[node, a], high[node, a] = least, most
            if most - least > widest:
                axis, widest = a, most - least
        if depth < levels:
            middle = (start + end) // 2
            _part(points, order, start, end, middle, axis)
            for child, first, last in ((2 * node + 2, middle, end), (2 * node + 1, start, middle)):
                nodes[top], starts[top], ends[top], depths[top] = child, first, last, depth + 1
                top += 1


@njit
def _part(points, order, start, end, middle, axis):
    """Reorder [start, end) so that no point before `middle` lies beyond one after it."""
    first, last = start, end - 1
    while first < last:
        pivot = points[(first + last) // 2, axis]
        i, j = first, last
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for a in range(3):
                    points[i, a], points[j, a] = points[j, a], points[i, a]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


@kernel
def vote(
    points,  # (P, 3) float64, as build_tree leaves them
    order,  # (P,) int32
    labels,  # (P,) int32, 0 to L - 1, in the tree's order
    low,  # (nodes, 3) float64
    high,  # (nodes, 3) float64
    levels,
    kinds,  # L
    means,  # (n, 3) float64
    whitening,  # (n, 3, 3) float64: its product with an offset has the Mahalanobis length
    radii,  # (n,) float64, metres
    most,  # candidates that count, at least 1
    winner,  # (n,) int32, out: label, -1 without a candidate
    share,  # (n,) float32, out: of the winner in the summed weight, 0 without a candidate
    nearest,  # (n,) float32, out: least Mahalanobis distance, inf without a candidate
    counted,  # (n,) int32, out: candidates
):
    """Write the label with the largest summed exp(-d^2 / 2) over each Gaussian's candidates."""
    distances, places = np.empty(2 * most), np.empty(2 * most, np.int64)
    sums, met = np.zeros(kinds), np.empty(min(most, kinds), np.int64)
    for g in range(len(means)):
        kept = _candidates(points, order, low, high, levels, means[g], radii[g], most, distances, places)
        counted[g] = kept
        if not kept:
            winner[g], share[g], nearest[g] = -1, 0.0, math.inf
            continue
        least = _whiten(points, means[g], whitening[g], kept, distances, places)
        total, kinds_met = 0.0, 0
        for k in range(kept):
            if distances[k] - least < NEGLIGIBLE:
                # Against the nearest candidate: the shares are the same, and a thin Gaussian beside a surface does
                # not lose every weight to underflow.
                weight = math.exp(-0.5 * (distances[k] - least))
                label = labels[places[k]]
                if sums[label] == 0.0:
                    met[kinds_met] = label
                    kinds_met += 1
                sums[label] += weight
                total += weight
        best = 0.0
        for k in range(kinds_met):
            best = max(best, sums[met[k]])
        chosen = kinds
        for k in range(kinds_met):
            if sums[met[k]] >= best * (1.0 - TIE):
                chosen = min(chosen, met[k])
        winner[g], share[g], nearest[g] = chosen, sums[chosen] / total, math.sqrt(least)
        for k in range(kinds_met):
            sums[met[k]] = 0.0


@njit
def _whiten(points, mean, whitening, kept, distances, places):
    """Overwrite distances by squared Mahalanobis ones and return the least."""
    least = math.inf
    for k in range(kept):
        at = places[k]
        dx, dy, dz = points[at, 0] - mean[0], points[at, 1] - mean[1], points[at, 2] - mean[2]
        squared = 0.0
        for a in range(3):
            along = whitening[a, 0] * dx + whitening[a, 1] * dy + whitening[a, 2] * dz
            squared += along * along
        distances[k] = squared
        least = min(least, squared)
    return least


@njit
def _candidates(points, order, low, high, levels, mean, radius, most, distances, places):
    """Write squared distances and places of the `most` nearest points within `radius`, and return their number.

    The two arrays hold twice as many: each time they are full the farther half is dropped, and from then on only what
    is nearer than the last one kept gets in.
    """
    nodes, starts, ends = np.empty(DEEPEST, np.int64), np.empty(DEEPEST, np.int64), np.empty(DEEPEST, np.int64)
    depths, gaps = np.empty(DEEPEST, np.int64), np.empty(DEEPEST)
    bound, bound_index = radius * radius, np.int64(len(points))
    nodes[0], starts[0], ends[0], depths[0], gaps[0] = 0, 0, len(points), 0, _gap(low, high, 0, mean)
    top, kept = 1, 0
    while top:
        top -= 1
        if gaps[top] > bound:
            continue
        node, start, end, depth = nodes[top], starts[top], ends[top], depths[top]
        while depth < levels:
            depth += 1
            middle = (start + end) // 2
            left, right = 2 * node + 1, 2 * node + 2
            left_gap, right_gap = _gap(low, high, left, mean), _gap(low, high, right, mean)
            if left_gap <= right_gap:
                nodes[top], starts[top], ends[top], depths[top], gaps[top] = right, middle, end, depth, right_gap
                node, end = left, middle
            else:
                nodes[top], starts[top], ends[top], depths[top], gaps[top] = left, start, middle, depth, left_gap
                node, start = right, middle
            if gaps[top] <= bound:
                top += 1
            if min(left_gap, right_gap) > bound:
                end = start
                break
        for i in range(start, end):
            dx, dy, dz = points[i, 0] - mean[0], points[i, 1] - mean[1], points[i, 2] - mean[2]
            squared = dx * dx + dy * dy + dz * dz
            if squared < bound or (squared == bound and order[i] < bound_index):
                distances[kept], places[kept] = squared, i
                kept += 1
                if kept == 2 * most:
                    _keep_nearest(distances, places, order, kept, most)
                    kept = most
                    bound, bound_index = distances[most - 1], np.int64(order[places[most - 1]])
    if kept > most:
        _keep_nearest(distances, places, order, kept, most)
        kept = most
    return kept


@njit
def _gap(low, high, node, mean):
    """Squared distance from a point to a node's box."""
    dx = max(low[node, 0] - mean[0], mean[0] - high[node, 0], 0.0)
    dy = max(low[node, 1] - mean[1], mean[1] - high[node, 1], 0.0)
    dz = max(low[node, 2] - mean[2], mean[2] - high[node, 2], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit
def _keep_nearest(distances, places, order, kept, most):
    """Bring the `most` smallest (distance, index) to the front, the largest of them last."""
    wanted, first, last = most - 1, 0, kept - 1
    while first < last:
        middle = (first + last) // 2
        pivot, pivot_index = distances[middle], order[places[middle]]
        i, j = first, last
        while i <= j:
            while distances[i] < pivot or (distances[i] == pivot and order[places[i]] < pivot_index):
                i += 1
            while distances[j] > pivot or (distances[j] == pivot and order[places[j]] > pivot_index):
                j -= 1
            if i <= j:
                distances[i], distances[j] = distances[j], distances[i]
                places[i], places[j] = places[j], places[i]
                i += 1
                j -= 1
        if wanted <= j:
            last = j
        elif wanted >= i:
            first = i
        else:
            return
