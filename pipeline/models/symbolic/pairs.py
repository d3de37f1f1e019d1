"""How the things of one view stand to each other, worked out once for all pairs: what `relations` looks up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pipeline.models.symbolic.knowledge import CONTAINERS, FLOOR_STANDING, GROUND, STRUCTURE, UPRIGHT
from pipeline.models.symbolic.thing import Thing

REST_M = 0.12
"""A thing rests on what lies at most this far below its lowest visible point: feet and edges are often hidden."""
REST_SHARE = 0.3
"""Share of a thing's lower outline that must meet its support."""
SMALL_BESIDE = 0.25
"""Share of a thing's volume below which another is small beside it."""
EDGE_M = 0.1
"""A footprint may stick out this far and still be over, under or in another."""
NEXT_TO_M = 0.6
"""Things with at most this gap are next to each other: an arm's length."""
NEAR_M = 1.5
"""Things with at most this gap are near each other: a step and a reach."""
UNDER_M = 0.4
"""Something with a larger gap above it is not under what hangs there: a bin under a wall shelf."""
BEHIND_M = 1.2
"""Something farther than this beyond a thing is no longer said to be behind it."""
STEP_M = 0.1
"""Smallest difference in place that counts as farther, higher or more to the left."""
POINT_SPACING_M = 0.05
"""Kept points lie about this far inside the true edge of a surface."""
ABOVE_M = 2.0
"""Something higher than this over a thing is no longer said to be above it."""
HANGING_M = 0.35
"""What touches a wall this high over the lowest thing in view hangs on it and does not stand before it."""
_RULES = (
    *(REST_M, REST_SHARE, SMALL_BESIDE, EDGE_M, NEXT_TO_M),
    *(UNDER_M, BEHIND_M, STEP_M, ABOVE_M, HANGING_M),
)

Table = list[list[bool]]
"""Whether a relation holds of [a][b]."""


class Standing(NamedTuple):
    """What `relations` says of each pair, without degrees."""

    on: Table
    inside: Table
    under: Table
    above: Table
    behind: Table
    beside: Table
    """Neither is over the other, or much higher."""


class Pairs:
    """Gaps and relations of the things of a view, each made when it is first asked for.

    Args:
        things: Things of the view.
        contacts: Which touch, see `View`.
    """

    def __init__(self, things: Sequence[Thing], contacts: Mapping[tuple[int, int], float]) -> None:
        self._things, self._contacts = things, contacts
        self._low = np.array([thing.low for thing in things]).reshape(-1, 3)
        self._high = np.array([thing.high for thing in things]).reshape(-1, 3)
        self._begins = np.zeros(len(things) + 1, np.int64)
        np.cumsum([len(thing.points) for thing in things], out=self._begins[1:])
        points = np.concatenate([np.empty((0, 3), np.float32), *(thing.points for thing in things)])
        self._points = np.ascontiguousarray(points.T)
        squares = self._points * self._points
        self._squared = squares[0] + squares[1] + squares[2]
        self._gaps: dict[int, list[float]] = {}
        self._standing: Standing | None = None

    def gap_m(self, a: int, b: int) -> float:
        """Return the gap between two things, the same both ways."""
        row = self._gaps.get(a)
        return row[b] if row is not None else self.gaps(b)[a]

    def gaps(self, index: int) -> Sequence[float]:
        """Return the gaps of a thing to all, metres."""
        row = self._gaps.get(index)
        if row is None:
            from pipeline.models.symbolic.pairs_kernels import gaps_of

            points = *self._points, self._squared, self._begins
            row = gaps_of(index, self._low, self._high, *points, NEAR_M, POINT_SPACING_M).tolist()
            self._gaps[index] = row
        return row

    @property
    def standing(self) -> Standing:
        """The relations of all pairs."""
        if self._standing is None:
            from pipeline.models.symbolic.pairs_kernels import stand

            contacts = np.zeros((len(self._things), len(self._things)))
            for pair, share in self._contacts.items():
                contacts[pair] = share
            kinds = np.array([_kinds(thing.kind) for thing in self._things], bool).reshape(-1, 5).T
            depths = (self._high - self._low)[:, ::2].min(axis=1, initial=np.inf).tolist()
            reach = np.array([(EDGE_M + 0.5 * depth + 0.5 * EDGE_M) ** 2 for depth in depths])
            place = self._low, self._high, self._points, self._begins
            self._standing = Standing(*stand(*place, reach, kinds, contacts, _RULES).tolist())
        return self._standing


@lru_cache(maxsize=1024)
def _kinds(kind: str) -> tuple[bool, ...]:
    return tuple(kind in kinds for kinds in (STRUCTURE, GROUND, UPRIGHT, FLOOR_STANDING, CONTAINERS))
