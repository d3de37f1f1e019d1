"""Per-process scene contexts: what a scene's questions share (prepared Gaussians, visibility, clusters, renders).

A worker process serves a few scenes at a time, so it keeps the last few contexts and drops the rest; a dropped one
is built again, with the same result.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

C = TypeVar("C")

KEPT = 2
"""Contexts kept: the scene being finished and the one being begun."""


class Recent(Generic[C]):
    """The last few values by key, built when asked for.

    Args:
        kept: How many are kept.
    """

    def __init__(self, kept: int = KEPT) -> None:
        self._kept = kept
        self._values: OrderedDict[str, C] = OrderedDict()

    def get(self, key: str, build: Callable[[], C]) -> C:
        """Return the value at `key`, building it when it is not kept; an error in `build` is kept of nothing."""
        if key not in self._values:
            value = build()
            self._values[key] = value
            while len(self._values) > self._kept:
                self._values.popitem(last=False)
        self._values.move_to_end(key)
        return self._values[key]

    def drop(self, key: str) -> None:
        """Forget the value at `key`, if it is kept."""
        self._values.pop(key, None)
