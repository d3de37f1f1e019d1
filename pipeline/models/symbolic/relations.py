"""How two things of one view stand to each other, judged from what is visible of them.

Every relation gives a degree from 0 (does not hold) to 1 (holds). The axes are those of the view: left, right, behind
and in front are as the viewer sees them. What is hidden is not guessed: a thing must be seen to be behind another.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from pipeline.models.symbolic.knowledge import CONTAINERS, FLOOR_STANDING, GROUND, STRUCTURE, UPRIGHT
from pipeline.models.symbolic.perceive import Thing, View

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
SIDE_M = 2.5
"""Something farther than this to the side is no longer said to be left or right of it."""
STEP_M = 0.1
"""Smallest difference in place that counts as farther, higher or more to the left."""
POINT_SPACING_M = 0.05
"""Kept points lie about this far inside the true edge of a surface."""
ABOVE_M = 2.0
"""Something higher than this over a thing is no longer said to be above it."""
HANGING_M = 0.35
"""What touches a wall this high over the lowest thing in view hangs on it and does not stand before it."""

Degree = Callable[[View, int, int], float]


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
    return float(np.clip(2.0 - gap_m(view, a, b) / NEXT_TO_M, 0.0, 1.0))


def near(view: View, a: int, b: int) -> float:
    """Return 1 within a step and a reach, falling to 0 at twice that."""
    return float(np.clip(2.0 - gap_m(view, a, b) / NEAR_M, 0.0, 1.0))


def left(view: View, a: int, b: int) -> float:
    """Return whether a is left of b as seen, and not far off."""
    first, second = view.things[a], view.things[b]
    apart = second.middle[0] - first.middle[0]
    clearly = apart > max(STEP_M, 0.25 * (first.size[0] + second.size[0]))
    return 1.0 if clearly and gap_m(view, a, b) <= SIDE_M else 0.0


def right(view: View, a: int, b: int) -> float:
    """Return whether a is right of b as seen, and not far off."""
    return left(view, b, a)


def in_front(view: View, a: int, b: int) -> float:
    """Return whether b is seen beyond a."""
    return behind(view, b, a)


def between(view: View, a: int, b: int, c: int) -> float:
    """Return whether a lies about on the line from b to c, seen from above."""
    point, start, stop = (view.things[i].middle[[0, 2]] for i in (a, b, c))
    line = stop - start
    length = float(np.linalg.norm(line))
    if length < STEP_M:
        return 0.0
    along = float((point - start) @ line) / length**2
    off = float(np.linalg.norm(point - start - along * line))
    return 1.0 if 0.1 < along < 0.9 and off <= max(0.4, 0.3 * length) else 0.0


def held_on(view: View, a: int, b: int) -> float:
    """Return whether a is on b in the loose way of speech, where a book is on a shelf that encloses it."""
    return max(on(view, a, b), 0.9 * inside(view, a, b))


def held_in(view: View, a: int, b: int) -> float:
    """Return whether a is in b in the loose way of speech: in a counter, in a bed, in what hardly encloses it."""
    inner, outer = view.things[a], view.things[b]
    sunk = inner.kind not in STRUCTURE and inner.high[1] <= outer.high[1] + STEP_M and _over(inner, outer, 0.0)
    sunk = sunk and inner.low[1] > outer.low[1] + STEP_M
    return max(inside(view, a, b), 0.9 * on(view, a, b), 0.9 * sunk)


DEGREES: dict[str, Degree] = {
    "on": held_on,
    "in": held_in,
    "under": under,
    "above": above,
    "behind": behind,
    "in front of": in_front,
    "next to": next_to,
    "near": near,
    "left": left,
    "right": right,
    "nearest": near,
    "facing": near,
}
"""Relations of two things; "between" takes three and "farthest" is a matter of comparison."""


def gap_m(view: View, a: int, b: int) -> float:
    """Return the gap between what is visible of two things, metres.

    The gap of their boxes where that is wide, else that of their points: the boxes of things that stand at an angle
    overlap where the things do not.
    """
    gap = view.gaps.get((a, b))
    if gap is None:
        gap = view.gaps[a, b] = _gap_m(view.things[a], view.things[b])
    return gap


def _gap_m(a: Thing, b: Thing) -> float:
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
