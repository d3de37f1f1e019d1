"""How two things of one view stand to each other, judged from what is visible of them.

Every relation gives a degree from 0 (does not hold) to 1 (holds). The axes are those of the view: left, right, behind
and in front are as the viewer sees them. What is hidden is not guessed: a thing must be seen to be behind another.
Those of `Pairs` are worked out there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.models.symbolic.knowledge import STRUCTURE
from pipeline.models.symbolic.pairs import NEAR_M, NEXT_TO_M, STEP_M
from pipeline.models.symbolic.view import View

SIDE_M = 2.5
"""Something farther than this to the side is no longer said to be left or right of it."""

Degree = Callable[[View, int, int], float]


def on(view: View, a: int, b: int) -> float:
    """Return whether a rests on b: it meets b from above, or its foot is at b's top and over it.

    Pictures, clocks and mirrors are on a wall: they touch it, stand out little and their foot is in the air. A pillow
    is lower than the headboard it lies before: beside what is much larger, height says little.
    """
    return float(view.pairs.standing.on[a][b])


def inside(view: View, a: int, b: int) -> float:
    """Return whether a is in b, a thing that can hold others: within its box and below its top."""
    return float(view.pairs.standing.inside[a][b])


def under(view: View, a: int, b: int) -> float:
    """Return whether a is under b: within its footprint, lower, close to it, and not resting on it."""
    return float(view.pairs.standing.under[a][b])


def above(view: View, a: int, b: int) -> float:
    """Return whether a is over b without resting on it.

    What hangs on the wall over a bed is above the bed, though not within its footprint.
    """
    return float(view.pairs.standing.above[a][b])


def behind(view: View, a: int, b: int) -> float:
    """Return whether a is seen beyond b: farther, at about the same bearing, not far off, and not part of the room."""
    return float(view.pairs.standing.behind[a][b])


def next_to(view: View, a: int, b: int) -> float:
    """Return 1 for a gap of an arm's length at most, falling to 0 at twice that; 0 for what is on, in or over it."""
    return _within(NEXT_TO_M, gap_m(view, a, b)) if view.pairs.standing.beside[a][b] else 0.0


def near(view: View, a: int, b: int) -> float:
    """Return 1 within a step and a reach, falling to 0 at twice that."""
    return _within(NEAR_M, gap_m(view, a, b))


def _within(reach_m: float, gap: float) -> float:
    return max(0.0, min(1.0, 2.0 - gap / reach_m))


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
    sunk = inner.kind not in STRUCTURE and inner.high[1] <= outer.high[1] + STEP_M
    sunk = sunk and inner.low[1] > outer.low[1] + STEP_M
    if sunk:
        x, _, z = inner.middle
        sunk = bool(outer.low[0] <= x <= outer.high[0] and outer.low[2] <= z <= outer.high[2])
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
    return view.pairs.gap_m(a, b)


def gaps_m(view: View, index: int) -> Sequence[float]:
    """Return the gaps of a thing to all of its view, see `gap_m`."""
    return view.pairs.gaps(index)
