# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Depth order: a stable radix sort of the survivors by float depth bits, ties by Gaussian id.

Serial. Depths are positive, so their bits sort like integers; only the bits in which they differ are sorted.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.render.project_kernels import DEPTH, RECORD
from pipeline.render.simd_kernels import float_bits

DIGIT = 11
"""Bits per pass: 2048 counters fit in the first-level cache."""


@njit(nogil=True, cache=True, error_model="numpy")
def put_depths(records, keys):
    """Put the depth bits of each key's row in its upper half; the row stays in the lower half."""
    for k in range(keys.size):
        row = keys[k] & np.uint64(0xFFFFFFFF)
        depth = records[np.int64(row) * RECORD + DEPTH]
        keys[k] = (np.uint64(float_bits(depth)) << np.uint64(32)) | row


@njit(nogil=True, cache=True, error_model="numpy")
def put_ids(ids, keys):
    """Put the Gaussian id of each key's row in its upper half; the row stays in the lower half."""
    for k in range(keys.size):
        row = keys[k] & np.uint64(0xFFFFFFFF)
        keys[k] = (np.uint64(ids[row]) << np.uint64(32)) | row


@njit(nogil=True, cache=True, error_model="numpy")
def sort_upper_half(keys, spare):
    """Sort keys by their upper 32 bits, stably; return the array (one of the two) that holds the result."""
    count = keys.size
    if count == 0:
        return keys
    every, some = keys[0], keys[0]
    for k in range(count):
        every &= keys[k]
        some |= keys[k]
    differing = (every ^ some) >> np.uint64(32)
    low, high = np.int64(32), np.int64(32)
    while differing >> np.uint64(high - 32):
        high += 1
    passes = (high - low + DIGIT - 1) // DIGIT
    source, target = keys, spare
    counters = np.empty(1 << DIGIT, np.int64)
    for number in range(passes):
        shift = np.uint64(low + number * DIGIT)
        counters[:] = 0
        for k in range(count):
            counters[(source[k] >> shift) & np.uint64((1 << DIGIT) - 1)] += 1
        total = np.int64(0)
        for digit in range(1 << DIGIT):
            here = counters[digit]
            counters[digit] = total
            total += here
        for k in range(count):
            digit = (source[k] >> shift) & np.uint64((1 << DIGIT) - 1)
            target[counters[digit]] = source[k]
            counters[digit] += 1
        source, target = target, source
    return source


@njit(nogil=True, cache=True, error_model="numpy")
def order_ties(keys, ids):
    """Order runs of equal depth by Gaussian id in place; return False where a run is too long for that.

    Insertion is quadratic in the run: the caller sorts long runs by radix instead.
    """
    start = 0
    for k in range(1, keys.size):
        if keys[k] >> np.uint64(32) != keys[k - 1] >> np.uint64(32):
            start = k
            continue
        if k - start > 32:
            return False
        key = keys[k]
        place = k
        while place > start and ids[keys[place - 1] & np.uint64(0xFFFFFFFF)] > ids[key & np.uint64(0xFFFFFFFF)]:
            keys[place] = keys[place - 1]
            place -= 1
        keys[place] = key
    return True
