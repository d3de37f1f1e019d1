"""Builders of things, by name. Each takes a random generator and returns a `Model` with its own colours and sizes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.scene.procedural.furniture import (
    bathroom,
    bedroom,
    containers,
    electronics,
    fixtures,
    kitchen,
    lights,
    seating,
    small,
    standing,
    storage,
    tables,
)
from pipeline.scene.procedural.things import Model

Builder = Callable[[np.random.Generator], Model]

_SIZED = {"door", "mat", "cupboard", "stone", "wicker"}
"""Functions that need more than a generator, or are no builders."""

BUILDERS: dict[str, Builder] = {
    name: function
    for module in (
        seating,
        tables,
        storage,
        bedroom,
        kitchen,
        bathroom,
        electronics,
        lights,
        containers,
        small,
        standing,
        fixtures,
    )
    for name, function in vars(module).items()
    if callable(function) and getattr(function, "__module__", "") == module.__name__
    if not name.startswith("_") and name not in _SIZED
}
"""Every builder that needs nothing but a generator."""

__all__ = ["BUILDERS", "Builder"]
