"""States that can be told from what a view shows: lights and screens, doors and fronts, what lies on or in a thing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.models.symbolic.knowledge import CASES, DOORS, LIGHTS, SCREENS, STRUCTURE
from pipeline.models.symbolic.perceive import View
from pipeline.models.symbolic.relations import gap_m, inside, on

LIT = 0.8
"""A lamp whose mean brightness is at least this shines: shaded paint stays below it."""
UNLIT = 0.62
"""A lamp below this is off; in between it may be a white shade in good light."""
SCREEN_LIT = 0.35
"""A screen brighter than this shows a picture; dark glass stays below it."""
SCREEN_DARK = 0.22
SWUNG = np.deg2rad(25.0)
"""A door leaf turned this far from its wall is open."""
ALIGNED = np.deg2rad(12.0)
"""A door leaf turned less than this from its wall is closed."""
FLAT_M = 0.06
"""A front whose visible points stray less than this from a plane is closed, if it is seen squarely enough."""
DEEP_M = 0.12
"""A front whose visible points stray more than this lets one look inside."""
NEAR_WALL_M = 0.6
"""A wall this close to a door is the one it belongs to."""


@dataclass(frozen=True, slots=True)
class State:
    """What is seen of a state."""

    value: str
    """open, closed, on, off, empty or full."""
    sure: bool
    """Seen well enough to say so without a hedge."""


def state_of(view: View, index: int, asked: str) -> State | None:
    """Return the state of a thing on the scale that was asked about, or None where the view does not tell.

    Args:
        view: The view.
        index: The thing.
        asked: A value of that scale: on or off, open or closed, empty or full.
    """
    thing = view.things[index]
    found: State | None = None
    if asked in ("on", "off"):
        found = _switched(view, index)
    elif asked in ("open", "closed"):
        found = _leaf(view, index) if thing.name in DOORS else _front(view, index) if thing.name in CASES else None
    elif asked in ("empty", "full"):
        found = _load(view, index)
    if found is None:
        return None
    return State(found.value, found.sure and thing.clear and not thing.cut)


def _switched(view: View, index: int) -> State | None:
    thing = view.things[index]
    if thing.name in LIGHTS:
        if thing.bright >= LIT:
            return State("on", True)
        return State("off", thing.bright < UNLIT)
    if thing.name in SCREENS:
        if thing.bright >= SCREEN_LIT:
            return State("on", True)
        return State("off", thing.bright < SCREEN_DARK)
    return None


def _leaf(view: View, index: int) -> State | None:
    """Compare the direction of a door leaf with that of the nearest wall."""
    door = view.things[index]
    walls = [i for i, thing in enumerate(view.things) if thing.name == "wall" and gap_m(thing, door) < NEAR_WALL_M]
    if not walls:
        return None
    turned = min(_angle(view.things[i].facing, door.facing) for i in walls)
    if turned >= SWUNG:
        return State("open", True)
    return State("closed", turned < ALIGNED)


def _front(view: View, index: int) -> State | None:
    thing = view.things[index]
    if thing.flatness > DEEP_M:
        return State("open", False)
    return State("closed", False) if thing.flatness < FLAT_M else None


def _load(view: View, index: int) -> State | None:
    """Something on or in it makes it full; nothing seen there makes it empty, without certainty."""
    for other, thing in enumerate(view.things):
        if other != index and thing.name not in STRUCTURE and (on(view, other, index) or inside(view, other, index)):
            return State("full", True)
    return State("empty", False)


def _angle(first: float, second: float) -> float:
    apart = abs(first - second) % np.pi
    return float(min(apart, np.pi - apart))
