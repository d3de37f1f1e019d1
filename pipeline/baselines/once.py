"""What a baseline works out once a scene: kept as long as the scene's context lives."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from pipeline.tasks.context import SceneContext

T = TypeVar("T")

_KEPT: WeakKeyDictionary[SceneContext, dict[Hashable, Any]] = WeakKeyDictionary()


def once(context: SceneContext, key: Hashable, make: Callable[[], T]) -> T:
    """Return what `make` gives, made at the first call with this key for this context.

    Args:
        context: The scene's caches.
        key: What is made and with which settings.
        make: Makes it.
    """
    kept = _KEPT.setdefault(context, {})
    if key not in kept:
        kept[key] = make()
    found: T = kept[key]
    return found
