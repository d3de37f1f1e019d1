# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""`kernel`: numba's njit for functions that Python calls, with a disk cache that cannot go stale.

numba keys a cached function by the date of its own file, so a change in a helper of another file would go unnoticed.
Here the key is the content of all kernel files.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from numba import njit


@lru_cache(maxsize=1)
def source_digest() -> str:
    """Return a hash of this file and all kernel files below it."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*_kernels.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def kernel(function):
    """Return `function`, to be compiled at its first call, run without the interpreter lock and kept on disk."""
    try:
        compiled = njit(nogil=True, cache=True, error_model="numpy")(function)
    except RuntimeError:  # numba finds no folder it may write to: compile in every process
        return njit(nogil=True, error_model="numpy")(function)
    # numba compares this with what it stored; it has no public way to say what a function depends on.
    compiled._cache._cache_file._source_stamp = source_digest()
    return compiled
