"""What `pairs` works out for all things of a view, in plain NumPy: pair by pair, as the rules are said."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from pipeline.models.symbolic.knowledge import CONTAINERS, FLOOR_STANDING, GROUND, STRUCTURE, UPRIGHT
from pipeline.models.symbolic.pairs import (
    ABOVE_M,
    BEHIND_M,
    EDGE_M,
    HANGING_M,
    NEAR_M,
    NEXT_TO_M,
    POINT_SPACING_M,
    REST_M,
    REST_SHARE,
    SMALL_BESIDE,
    STEP_M,
    UNDER_M,
)
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View


def on(view: View, a: int, b: int) -> float:
    """Return whether a rests on b: it meets b from above, or its foot is at b's top and over it."""
    upper, lower = view.things[a], view.things[b]
    if upper.kind in STRUCTURE or (upper.kind in UPRIGHT and lower.kind not in UPRIGHT):
        return 0.0
    if upper.kind in FLOOR_STANDING and lower.kind not in GROUND:
        return 0.0
    if lower.kind in UPRIGHT:
        return _hangs_on(view, a, b)
    if lower.high[1] < upper.low[1] - REST_M or upper.low[1] < lower.low[1] - STEP_M:
        return 0.0
    if lower.kind in GROUND:
        return 1.0 if upper.low[1] - lower.high[1] <= REST_M and view.contacts.get((a, b), 0.0) > 0 else 0.0
    if (upper.size[[0, 2]] > 1.5 * lower.size[[0, 2]] + EDGE_M).any():
        return 0.0
    touches = view.contacts.get((a, b), 0.0) >= REST_SHARE
    beneath = _beside_axis(upper, lower)
    level = bool((np.abs(beneath[:, 1] - upper.low[1]) <= REST_M).any())
    # A pillow is lower than the headboard: beside what is much larger, height says little.
    higher = upper.middle[1] > lower.middle[1] or float(np.prod(upper.size)) < SMALL_BESIDE * float(np.prod(lower.size))
    return 1.0 if higher and (touches or level) else 0.0


def _hangs_on(view: View, a: int, b: int) -> float:
    """Pictures, clocks and mirrors: they touch the wall, stand out little and their foot is in the air."""
    thing, wall = view.things[a], view.things[b]
    touches = view.contacts.get((a, b), 0.0) + view.contacts.get((b, a), 0.0) > 0
    bottom = min(other.low[1] for other in view.things)
    in_air = thing.low[1] - bottom > HANGING_M
    resting = any(lower != b and share >= REST_SHARE for (upper, lower), share in view.contacts.items() if upper == a)
    return (
        1.0 if touches and in_air and not resting and thing.size.min() < 0.5 and wall.size[1] > thing.size[1] else 0.0
    )


def inside(view: View, a: int, b: int) -> float:
    """Return whether a is in b, a thing that can hold others: within its box and below its top."""
    inner, outer = view.things[a], view.things[b]
    if outer.kind not in CONTAINERS or inner.kind in STRUCTURE | FLOOR_STANDING:
        return 0.0
    if inner.size[0] > outer.size[0] + EDGE_M or inner.size[1] > outer.size[1] + EDGE_M:
        return 0.0
    below_top = inner.middle[1] < outer.high[1] and inner.low[1] < outer.high[1] - 0.03
    above_foot = inner.low[1] > outer.low[1] - 2 * EDGE_M
    return 1.0 if below_top and above_foot and _over(inner, outer, EDGE_M) and len(_beside_axis(inner, outer)) else 0.0


def under(view: View, a: int, b: int) -> float:
    """Return whether a is under b: within its footprint, lower, close to it, and not resting on it."""
    lower, upper = view.things[a], view.things[b]
    if lower.kind in STRUCTURE or upper.kind in STRUCTURE or view.contacts.get((a, b), 0.0) >= REST_SHARE:
        return 0.0
    if inside(view, a, b) or on(view, b, a) or on(view, a, b):
        return 0.0
    lies_lower = lower.high[1] < upper.high[1] - STEP_M and lower.middle[1] < upper.middle[1]
    close = lower.low[1] <= upper.low[1] + REST_M and upper.low[1] - lower.high[1] <= UNDER_M
    fits = bool((lower.size[[0, 2]] <= upper.size[[0, 2]] + EDGE_M).all())
    covered = bool((_beside_axis(lower, upper)[:, 1] > lower.high[1]).any())
    return 1.0 if lies_lower and close and fits and covered and _over(lower, upper, EDGE_M) else 0.0


def above(view: View, a: int, b: int) -> float:
    """Return whether a is over b without resting on it."""
    upper, lower = view.things[a], view.things[b]
    gap = upper.low[1] - lower.high[1]
    if not -STEP_M <= gap <= ABOVE_M or on(view, a, b):
        return 0.0
    # What hangs on the wall over a bed is above the bed, though not within its footprint.
    return 1.0 if abs(_side_gap(upper, lower)) <= EDGE_M and _depth_gap(upper, lower) <= NEXT_TO_M else 0.0


def behind(view: View, a: int, b: int) -> float:
    """Return whether a is seen beyond b: farther, at about the same bearing, not far off, and not part of the room."""
    far, near = view.things[a], view.things[b]
    if far.middle[2] < near.middle[2] + STEP_M or far.low[2] < near.low[2] + STEP_M:
        return 0.0
    if _side_gap(far, near) > EDGE_M or _depth_gap(far, near) > BEHIND_M or on(view, a, b) or inside(view, a, b):
        return 0.0
    if under(view, a, b) or far.low[1] > near.high[1] + STEP_M:
        return 0.0
    return 1.0


def next_to(view: View, a: int, b: int) -> float:
    """Return 1 for a gap of an arm's length at most, falling to 0 at twice that; 0 for what is on, in or over it."""
    first, second = view.things[a], view.things[b]
    vertical = max(first.low[1] - second.high[1], second.low[1] - first.high[1])
    if vertical > NEXT_TO_M or _over(first, second, 0.0) or _over(second, first, 0.0):
        return 0.0
    return float(np.clip(2.0 - gap_m(first, second) / NEXT_TO_M, 0.0, 1.0))


def gap_m(a: Thing, b: Thing) -> float:
    """Return the gap of two boxes, or of the points in them where the boxes are near."""
    apart = np.maximum(0.0, np.maximum(a.low - b.high, b.low - a.high))
    box = math.sqrt(apart.dot(apart))
    if box > NEAR_M or not len(a.points) or not len(b.points):
        return box
    squared = _squares(a)[:, None] + _squares(b) - 2.0 * a.points @ b.points.T
    return max(box, math.sqrt(max(0.0, float(np.minimum.reduce(squared, axis=None)))) - POINT_SPACING_M)


def _squares(thing: Thing) -> Float[np.ndarray, "K"]:
    squared = thing.points * thing.points
    return squared[:, 0] + squared[:, 1] + squared[:, 2]


def _beside_axis(a: Thing, b: Thing) -> Float[np.ndarray, "N 3"]:
    """Return the points of b about the upright line through the middle of a: what may hold, cover or enclose it."""
    reach = EDGE_M + 0.5 * float(min(a.size[0], a.size[2])) + 0.5 * EDGE_M
    offset = b.points[:, [0, 2]] - a.middle[[0, 2]]
    return b.points[(offset**2).sum(axis=1) <= reach**2]


def _over(a: Thing, b: Thing, margin: float) -> bool:
    """Return whether the middle of a is over b's footprint, seen from above."""
    x, _, z = a.middle
    return bool(b.low[0] - margin <= x <= b.high[0] + margin and b.low[2] - margin <= z <= b.high[2] + margin)


def _side_gap(a: Thing, b: Thing) -> float:
    return float(max(0.0, a.low[0] - b.high[0], b.low[0] - a.high[0]))


def _depth_gap(a: Thing, b: Thing) -> float:
    return float(max(0.0, a.low[2] - b.high[2], b.low[2] - a.high[2]))
