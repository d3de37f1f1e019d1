# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Depth order: a stable radix sort of the survivors by float depth bits, ties by Gaussian id.

Serial. Depths are positive, so their bits sort like integers; only the bits of their range are sorted.
"""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel
from pipeline.render.project_kernels import DEPTH, RECORD
from pipeline.render.simd_kernels import at, float_bits, put

DIGIT = 13
"""Bits per pass, at most: 8192 counters fit in the first-level cache, and depths of a room need two passes."""


@kernel
def put_depths(records, keys):
    """Put the depth bits of each key's row in its upper half; the row stays in the lower half."""
    for k in range(keys.size):
        row = keys[k] & np.uint64(0xFFFFFFFF)
        depth = records[np.int64(row) * RECORD + DEPTH]
        keys[k] = (np.uint64(float_bits(depth)) << np.uint64(32)) | row


@kernel
def put_ids(ids, keys):
    """Put the Gaussian id of each key's row in its upper half; the row stays in the lower half."""
    for k in range(keys.size):
        row = keys[k] & np.uint64(0xFFFFFFFF)
        keys[k] = (np.uint64(ids[row]) << np.uint64(32)) | row


@kernel
def sort_upper_half(keys, spare):
    """Sort keys by their upper 32 bits, stably; return the array (one of the two) that holds the result."""
    count = keys.size
    if count < 2:
        return keys
    low, high = keys[0] >> np.uint64(32), keys[0] >> np.uint64(32)
    for k in range(count):
        low, high = min(low, keys[k] >> np.uint64(32)), max(high, keys[k] >> np.uint64(32))
    bits = 0
    while (high - low) >> np.uint64(bits) != 0:
        bits += 1
    passes = (bits + DIGIT - 1) // DIGIT
    if passes == 0:
        return keys
    width = (bits + passes - 1) // passes
    mask = np.uint64((1 << width) - 1)
    counters = np.zeros((passes, 1 << width), np.int32)
    for number in range(passes):
        shift = np.uint64(number * width)
        for k in range(count):
            digit = np.int64((((at(keys, k) >> np.uint64(32)) - low) >> shift) & mask)
            counters[number, digit] += np.int32(1)
    source, target = keys, spare
    for number in range(passes):
        places = counters[number]
        total = np.int32(0)
        for bucket in range(1 << width):
            here = places[bucket]
            places[bucket] = total
            total += here
        shift = np.uint64(number * width)
        for k in range(count):
            key = at(source, k)
            digit = np.int64((((key >> np.uint64(32)) - low) >> shift) & mask)
            place = at(places, digit)
            put(target, np.int64(place), key)
            put(places, digit, place + np.int32(1))
        source, target = target, source
    return source


@kernel
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
