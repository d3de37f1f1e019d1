# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""A 128-bit fingerprint of an array, at the speed of memory: for finding a picture again within one process.

Lanes are mixed word by word, each step one-to-one, so two arrays that differ in one word never meet; others do by
chance, once in 2^64 or so. It is no protection against someone who wants two pictures to meet, and is never stored.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

# Words mixed side by side: enough that one product need not wait for the last.
LANES = 64
# Odd constants of 64 bits (from splitmix64), which spread a bit over all higher ones.
_SPREAD = np.uint64(0xBF58476D1CE4E5B9)
_MIX = np.uint64(0x94D049BB133111EB)
_STEP = np.uint64(0x9E3779B97F4A7C15)
_HALF = np.uint64(32)


@kernel
def fingerprint(words, tail):
    """Return two uint64 for words (N,) uint64 and the bytes after them, tail (n,) uint8."""
    lanes = np.empty(LANES, np.uint64)
    for lane in range(LANES):
        lanes[lane] = _STEP * np.uint64(lane + 1)
    blocks = len(words) // LANES
    for block in range(blocks):
        row = words[block * LANES : (block + 1) * LANES]
        for lane in range(LANES):
            mixed = (lanes[lane] ^ row[lane]) * _SPREAD
            lanes[lane] = mixed ^ (mixed >> _HALF)
    first, second = np.uint64(len(words)), np.uint64(len(tail))
    for lane in range(LANES):
        first, second = _mixed(first, lanes[lane]), _mixed(second, lanes[LANES - 1 - lane])
    for at in range(blocks * LANES, len(words)):
        first, second = _mixed(first, words[at]), _mixed(second, words[at])
    for byte in tail:
        first, second = _mixed(first, np.uint64(byte)), _mixed(second, np.uint64(byte))
    return first, second


@njit
def _mixed(state, word):
    state = (state ^ word) * _MIX
    return (state ^ (state >> _HALF)) * _SPREAD + _STEP
