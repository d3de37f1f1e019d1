"""A thing seen in a view: a name, a colour, a place and a size.

Positions are metres in axes at the camera, aligned with gravity: right, up, forward. Only visible surfaces count:
a box is the box of what is seen, never of the whole object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """One thing seen in a view."""

    name: str
    """Category name."""
    kind: str
    """Its canonical name, by which one knows what such things are like."""
    share: float
    """Share of the image it covers, 0 to 1."""
    center: tuple[float, float]
    """Centre of its outline's box: column and row as shares of width and height."""
    cut: bool
    """The image border cuts it."""
    clear: bool
    """Large and whole enough to be certain of its name."""
    color: str
    """Name most of its pixels carry."""
    second_color: str
    """Next most frequent name where it is common too, else empty."""
    bright: float
    """Mean brightness, 0 to 1."""
    peak: float
    """Brightness that only its brightest 2 % exceed."""
    low: Float[np.ndarray, "3"]
    """Lower corner of its visible box: right, up, forward, metres."""
    high: Float[np.ndarray, "3"]
    """Upper corner."""
    points: Float[np.ndarray, "K 3"]
    """Some of its visible points, spread evenly, in the same axes."""
    distance: float
    """Median distance from the camera, metres."""
    free_edges: tuple[float, ...] = ()
    """Of a door: see `shapes.free_edges`; empty for other things."""
    hollow: float = 0.0
    """Of a thing that opens: see `shapes.hollow`; 0 for other things."""

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        """Centre of the visible box."""
        return 0.5 * (self.low + self.high)

    @property
    def size(self) -> Float[np.ndarray, "3"]:
        """Sides of the visible box: right, up, forward."""
        return self.high - self.low
