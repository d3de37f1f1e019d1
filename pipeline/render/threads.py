"""Ranges of work on threads: kernels release the interpreter lock, so plain threads run them side by side."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import count, pairwise
from threading import Lock


def split(total: int, parts: int) -> list[tuple[int, int]]:
    """Return at most `parts` non-empty ranges that cover 0 to `total`, in order, equal within one."""
    parts = max(1, min(parts, total))
    edges = [total * k // parts for k in range(parts + 1)]
    return [(a, b) for a, b in pairwise(edges) if b > a]


def run_each(work: Callable[[int], None], number: int, threads: int) -> None:
    """Call work(0) ... work(number - 1), on up to `threads` threads; whoever is free takes the next one.

    With one thread (or one piece) everything runs in the caller. The first exception is raised here.
    """
    if threads <= 1 or number <= 1:
        for k in range(number):
            work(k)
        return
    numbers, lock = count(), Lock()

    def drain() -> None:
        while True:
            with lock:
                k = next(numbers)
            if k >= number:
                return
            work(k)

    helpers = [_pool(os.getpid()).submit(drain) for _ in range(min(threads, number) - 1)]
    try:
        drain()
    finally:
        errors = [helper.exception() for helper in helpers]
    for error in errors:
        if error is not None:
            raise error


@lru_cache(maxsize=1)
def _pool(process: int) -> ThreadPoolExecutor:
    """One pool per process: threads do not survive a fork, so the process number is part of the key."""
    return ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="render")
