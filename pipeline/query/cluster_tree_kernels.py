# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The least spanning tree of mutual reachability, exactly, and its single linkage. Serial.

Boruvka's rounds: each group of joined points takes its shortest edge out. An edge of a point is never shorter than its
core distance, and all points nearer than that are among its neighbours. So the neighbours are tried first, and a k-d
tree only for points whose core distance is below the best edge found; its boxes that lie in one group are skipped.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

LEAF = 8
"""Most points of a leaf box."""


@kernel
def split(points):
    """Return the order of points (n, 3) in which each node of the k-d tree is a run, (n,) int64.

    Node i has the children 2 i + 1 and 2 i + 2 and each half of its run; the shorter half first.
    """
    count = len(points)
    order = np.arange(count)
    runs = [(0, count)]
    while runs:
        low, high = runs.pop()
        if high - low <= LEAF:
            continue
        widest, axis = -1.0, 0
        for dim in range(3):
            least = most = points[order[low], dim]
            for place in range(low + 1, high):
                least, most = min(least, points[order[place], dim]), max(most, points[order[place], dim])
            if most - least > widest:
                widest, axis = most - least, dim
        middle = (low + high) // 2
        _halve(points, order, axis, low, high - 1, middle)
        runs.append((low, middle))
        runs.append((middle, high))
    return order


@njit
def _halve(points, order, axis, low, high, middle):
    """Reorder places low to high so that none before `middle` is above it on the axis and none after it below."""
    while low < high:
        pivot = points[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while points[order[i], axis] < pivot:
                i += 1
            while points[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def boxes(points, cores):
    """Return runs (nodes, 2) int64, boxes (nodes, 6) and least core distances (nodes,) of points in `split`'s order."""
    nodes = 1
    while (len(points) + nodes - 1) // nodes > LEAF:
        nodes *= 2
    nodes = 2 * nodes - 1
    runs, bounds, least = np.zeros((nodes, 2), np.int64), np.empty((nodes, 6)), np.empty(nodes)
    runs[0, 1] = len(points)
    for node in range(nodes // 2):
        low, high = runs[node]
        middle = (low + high) // 2
        runs[2 * node + 1] = low, middle
        runs[2 * node + 2] = middle, high
    for node in range(nodes - 1, -1, -1):
        low, high = runs[node]
        if 2 * node + 1 < nodes:
            one, two = 2 * node + 1, 2 * node + 2
            least[node] = min(least[one], least[two])
            for dim in range(3):
                bounds[node, dim] = min(bounds[one, dim], bounds[two, dim])
                bounds[node, dim + 3] = max(bounds[one, dim + 3], bounds[two, dim + 3])
        else:
            least[node] = cores[low:high].min()
            for dim in range(3):
                bounds[node, dim] = points[low:high, dim].min()
                bounds[node, dim + 3] = points[low:high, dim].max()
    return runs, bounds, least


@kernel
def spanning_tree(points, cores, neighbours, runs, bounds, least):
    """Return first, second (n - 1,) int64 and lengths (n - 1,) of the tree's edges.

    Takes points (n, 3) in the order of `split`, cores (n,), neighbours (n, k) int32: all points nearer to a point than
    its core distance, and the rest from `boxes`.
    """
    count = len(points)
    group = np.arange(count)
    inside = np.zeros(count, np.bool_)
    first, second = np.empty(count - 1, np.int64), np.empty(count - 1, np.int64)
    lengths = np.empty(count - 1)
    shortest, ones, others = np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64)
    held = np.empty(len(runs), np.int64)
    stack = np.empty(128, np.int64)
    found = 0
    while found < count - 1:
        shortest[:] = np.inf
        for point in range(count):
            if not inside[point]:
                inside[point] = _try_neighbours(points, cores, neighbours, group, point, shortest, ones, others)
        _hold(held, runs, group)
        for point in range(count):
            own = group[point]
            if cores[point] < shortest[own]:
                other, reach = _nearest_outside(
                    points, cores, runs, bounds, least, held, stack, group, point, shortest[own]
                )
                if other >= 0:
                    shortest[own], ones[own], others[own] = reach, point, other
        for root in range(count):
            if shortest[root] < np.inf:
                a, b = _root(group, ones[root]), _root(group, others[root])
                if a != b:
                    first[found], second[found], lengths[found] = ones[root], others[root], shortest[root]
                    found += 1
                    group[max(a, b)] = min(a, b)
        for point in range(count):
            group[point] = _root(group, point)
    return first, second, lengths


@njit
def _try_neighbours(points, cores, neighbours, group, point, shortest, ones, others):
    """Offer a point's edges to its neighbours to both groups; return whether all lie in its own."""
    inside, own = True, group[point]
    for other in neighbours[point]:
        if group[other] == own:
            continue
        inside = False
        reach = max(_distance(points, point, other), cores[point], cores[other])
        for at in (own, group[other]):
            if reach < shortest[at]:
                shortest[at], ones[at], others[at] = reach, point, other
    return inside


@njit
def _hold(held, runs, group):
    """Fill held (nodes,) with the one group of a node's points, or -1."""
    nodes = len(runs)
    for node in range(nodes - 1, -1, -1):
        if 2 * node + 1 < nodes:
            one, two = held[2 * node + 1], held[2 * node + 2]
            held[node] = one if one == two else -1
        else:
            low, high = runs[node]
            held[node] = group[low]
            for place in range(low + 1, high):
                if group[place] != group[low]:
                    held[node] = -1


@njit
def _nearest_outside(points, cores, runs, bounds, least, held, stack, group, point, limit):
    """Return the point of another group that a point reaches within less than `limit`, or -1, and how far it is."""
    nodes, own, best, top = len(runs), group[point], -1, 1
    stack[0] = 0
    while top:
        top -= 1
        node = stack[top]
        if held[node] == own or least[node] >= limit or _gap(bounds, node, points, point) >= limit * limit:
            continue
        if 2 * node + 1 < nodes:
            one, two = 2 * node + 1, 2 * node + 2
            if _gap(bounds, one, points, point) < _gap(bounds, two, points, point):
                one, two = two, one
            stack[top], stack[top + 1] = one, two
            top += 2
            continue
        for other in range(runs[node, 0], runs[node, 1]):
            if group[other] != own and cores[other] < limit:
                reach = max(_distance(points, point, other), cores[point], cores[other])
                if reach < limit:
                    limit, best = reach, other
    return best, limit


@njit
def _gap(bounds, node, points, point):
    """Squared distance from a point to a node's box."""
    total = 0.0
    for dim in range(3):
        value = points[point, dim]
        away = max(bounds[node, dim] - value, value - bounds[node, dim + 3], 0.0)
        total += away * away
    return total


@njit
def _distance(points, one, other):
    x, y, z = points[one, 0] - points[other, 0], points[one, 1] - points[other, 1], points[one, 2] - points[other, 2]
    return np.sqrt(x * x + y * y + z * z)


@njit
def _root(parents, node):
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@kernel
def link(first, second):
    """Return left, right (n - 1,) of the single-linkage tree whose joins are these edges, shortest first."""
    joins = len(first)
    parents = np.arange(2 * joins + 1)
    left, right = np.empty(joins, np.int64), np.empty(joins, np.int64)
    for join in range(joins):
        a, b = _root(parents, first[join]), _root(parents, second[join])
        left[join], right[join] = a, b
        parents[a] = parents[b] = joins + 1 + join
    return left, right
