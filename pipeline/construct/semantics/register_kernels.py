# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops of registration: one frame's votes per pair of Gaussian and label, and the sum of two sorted lists of pairs.

A frame is tallied by one thread: pixels in reading order, contributors heaviest first, so its bits are always the same.
Every Gaussian heads a short chain of the labels it met; most meet one or two in a frame.
"""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel

FIRST_ROOM = 1 << 16
"""Pairs there is room for at first; doubled when full."""


@kernel
def tally(
    ids,  # (P, k) int32: contributors of each pixel, -1 after the last
    weights,  # (P, k) float32
    labels,  # (P,) int32, -1 for silence
    confidence,  # (P,) float32, or (0,) for 1 everywhere; silence is not weighed
    gaussians,  # M
):
    """Return the keys, gaussian << 32 | label + 1, in the order they were met, and the summed weight of each."""
    head = np.full(gaussians, -1, np.int32)
    follows = np.empty(FIRST_ROOM, np.int32)
    keys, sums = np.empty(FIRST_ROOM, np.int64), np.empty(FIRST_ROOM, np.float64)
    count = 0
    for pixel in range(len(labels)):
        factor = 1.0
        if labels[pixel] >= 0 and len(confidence):
            factor = np.float64(confidence[pixel])
        if factor == 0.0:
            continue
        for k in range(ids.shape[1]):
            g = ids[pixel, k]
            if g < 0:
                break
            key = (np.int64(g) << 32) | (np.int64(labels[pixel]) + 1)
            place = head[g]
            while place >= 0 and keys[place] != key:
                place = follows[place]
            if place < 0:
                if count == len(keys):
                    follows = np.concatenate((follows, np.empty(count, np.int32)))
                    keys = np.concatenate((keys, np.empty(count, np.int64)))
                    sums = np.concatenate((sums, np.empty(count, np.float64)))
                place = count
                keys[place], sums[place], follows[place] = key, 0.0, head[g]
                head[g] = place
                count += 1
            sums[place] += factor * weights[pixel, k]
    return keys[:count].copy(), sums[:count].copy()


@kernel
def add_sorted(
    keys,  # (a,) int64, rising
    sums,  # (a,) float64
    other_keys,  # (b,) int64, rising
    other_sums,  # (b,) float64
):
    """Return the rising keys of both lists and their sums, the first list's first in each addition."""
    shared = 0
    i = 0
    for j in range(len(other_keys)):
        while i < len(keys) and keys[i] < other_keys[j]:
            i += 1
        shared += i < len(keys) and keys[i] == other_keys[j]
    out_keys = np.empty(len(keys) + len(other_keys) - shared, np.int64)
    out_sums = np.empty(len(out_keys), np.float64)
    i = j = 0
    for place in range(len(out_keys)):
        if j == len(other_keys) or (i < len(keys) and keys[i] < other_keys[j]):
            out_keys[place], out_sums[place] = keys[i], sums[i]
            i += 1
        elif i == len(keys) or other_keys[j] < keys[i]:
            out_keys[place], out_sums[place] = other_keys[j], other_sums[j]
            j += 1
        else:
            out_keys[place], out_sums[place] = keys[i], sums[i] + other_sums[j]
            i += 1
            j += 1
    return out_keys, out_sums
