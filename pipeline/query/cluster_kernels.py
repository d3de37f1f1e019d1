# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Clusters out of a single-linkage tree whose leaves may stand for several points each.

The rules are those of HDBSCAN with `cluster_selection_epsilon` (Campello 2013; Malzer and Baum 2020): branches of
fewer than `least` points fall off, the most stable clusters are kept, and those that split off under epsilon go back
into the cluster they split from. Libraries count a leaf as one point; here it has a weight. With all weights 1 the
result is the library's (tests/query/test_cluster_kernels.py).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

NOISE = -1
# Two points at one place: their level of density is bounded, so that sums stay finite.
NEAREST_M = 1e-9


@kernel
def select_clusters(left, right, distances, weights, least, epsilon, grain):
    """Return the cluster of each leaf, (m,) int64, -1 none.

    Node i < m is leaf i; node m + i joins left[i] and right[i] (m - 1,) int64 at distances[i] (m - 1,) float64, which
    does not fall. Takes weights (m,) int64, the points of each leaf. A leaf of `least` points or more is a cluster
    that comes apart at the distance `grain`.
    """
    count = len(weights)
    nodes = 2 * count - 1
    sizes = np.empty(nodes, np.int64)
    sizes[:count] = weights
    for join in range(count - 1):
        sizes[count + join] = sizes[left[join]] + sizes[right[join]]
    # A cluster has a higher number than its parent. Levels are 1 / distance.
    owner = np.zeros(nodes, np.int64)
    fell = np.full(nodes, -1.0)
    parent = np.full(nodes, -1, np.int64)
    birth, stability = np.zeros(nodes), np.zeros(nodes)
    clusters, last = 1, 0.0
    for node in range(nodes - 1, -1, -1):
        cluster = owner[node]
        if fell[node] >= 0.0:
            if node >= count:
                for child in (left[node - count], right[node - count]):
                    owner[child], fell[child] = cluster, fell[node]
            continue
        if node < count:  # alone it holds enough points
            level = max(1.0 / max(grain, NEAREST_M), birth[cluster]) if sizes[node] >= least else birth[cluster]
            stability[cluster] += (level - birth[cluster]) * sizes[node]
            fell[node] = level
            if cluster == 0:
                last = max(last, level)
            continue
        level = 1.0 / max(distances[node - count], NEAREST_M)
        first, second = left[node - count], right[node - count]
        if cluster == 0:
            last = max(last, level)
        both = sizes[first] >= least and sizes[second] >= least
        for child in (first, second):
            if both or sizes[child] < least:
                stability[cluster] += (level - birth[cluster]) * sizes[child]
        for child in (first, second):
            owner[child] = cluster
            if both:
                owner[child], parent[clusters], birth[clusters] = clusters, cluster, level
                clusters += 1
            elif sizes[child] < least:
                fell[child] = level
    chosen = _stable(parent, stability, clusters)
    chosen = _lifted(parent, birth, chosen, clusters, epsilon)
    return _labels(owner, fell, parent, chosen, clusters, count, epsilon, last)


@njit
def _stable(parent, stability, clusters):
    """Clusters that are at least as stable as all that come out of them, none inside another."""
    below = np.zeros(clusters)
    chosen = np.ones(clusters, np.bool_)
    for cluster in range(clusters - 1, -1, -1):
        chosen[cluster] = below[cluster] <= stability[cluster]
        if cluster:
            below[parent[cluster]] += max(below[cluster], stability[cluster])
    _keep_uppermost(parent, chosen, clusters)
    return chosen


@njit
def _keep_uppermost(parent, chosen, clusters):
    inside = np.zeros(clusters, np.bool_)
    for cluster in range(1, clusters):
        inside[cluster] = inside[parent[cluster]] or chosen[parent[cluster]]
        if inside[cluster]:
            chosen[cluster] = False


@njit
def _lifted(parent, birth, chosen, clusters, epsilon):
    """The same clusters, where one that split off under epsilon gives way to its first ancestor that did not."""
    if chosen[0]:
        return chosen
    lifted = np.zeros(clusters, np.bool_)
    for cluster in range(1, clusters):
        if chosen[cluster]:
            at = cluster
            if birth[at] * epsilon > 1.0:
                at = parent[at]
                while at and birth[at] * epsilon >= 1.0:
                    at = parent[at]
            lifted[at] = True
    _keep_uppermost(parent, lifted, clusters)
    return lifted


@njit
def _labels(owner, fell, parent, chosen, clusters, count, epsilon, last):
    numbers = np.full(clusters, NOISE, np.int64)
    found = 0
    for cluster in range(clusters):
        if chosen[cluster]:
            numbers[cluster] = found
            found += 1
        elif cluster:
            numbers[cluster] = numbers[parent[cluster]]
    # A lone root holds every leaf: only those as dense as epsilon (or, without one, as the densest) are in the cluster.
    least_level = 0.0
    if chosen[0]:
        least_level = 1.0 / epsilon if epsilon > 0.0 else last
    labels = np.full(count, NOISE, np.int64)
    for leaf in range(count):
        if fell[leaf] >= least_level:
            labels[leaf] = numbers[owner[leaf]]
    return labels
