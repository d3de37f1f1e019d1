"""States that can be told from what a view shows: lights and screens, doors and cases, what lies on or in a thing."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.models.symbolic.knowledge import CASES, CURTAINS, DOORS, LIGHTS, SCREENS, STRUCTURE, VESSELS
from pipeline.models.symbolic.relations import gap_m, inside, on
from pipeline.models.symbolic.view import View

GLOWS = 0.98
"""A light whose brightest part reaches this is on: a lamp overexposes, white paint in a lit room does not."""
STANDS_OUT = 0.15
"""The bright part of a light that is on must be brighter than the whole of it by this, or all of it must glow."""
SCREEN_LIT = 0.35
"""A screen brighter than this shows a picture; dark glass stays below it."""
SCREEN_DARK = 0.22
AJAR = 0.5
"""Share of an upright edge of a door with air behind it from which on the door is open."""
SHUT = 0.15
"""Share below which it is closed; in between the view does not tell."""
LOOKED_INTO = 0.15
"""Share of a case's pixels that lie inside it from which on it is open."""
SOLID = 0.05
"""Share below which it is closed."""
LID_M = 0.1
"""A laptop that stands this high is open."""
BARE_WINDOW = 0.3
"""A window that shows this share of its curtain's area is not covered by it."""
CURTAIN_REACH_M = 0.5
"""A curtain hangs at most this far from its window."""


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
    found: State | None = None
    if asked in ("on", "off"):
        found = _switched(view, index)
    elif asked in ("open", "closed"):
        found = _opened(view, index)
    elif asked in ("empty", "full"):
        found = _load(view, index)
    return None if found is None else State(found.value, found.sure and view.things[index].clear)


def _switched(view: View, index: int) -> State | None:
    thing = view.things[index]
    if thing.kind in LIGHTS:
        glows = thing.peak >= GLOWS and (thing.peak - thing.bright >= STANDS_OUT or thing.bright >= GLOWS - 0.1)
        if glows:
            return State("on", True)
        # A cut lamp may have its shade outside the image.
        return State("off", not thing.cut and thing.peak < GLOWS)
    if thing.kind in SCREENS:
        if thing.bright >= SCREEN_LIT:
            return State("on", True)
        return State("off", thing.bright < SCREEN_DARK)
    return None


def _opened(view: View, index: int) -> State | None:
    thing = view.things[index]
    if thing.kind in DOORS:
        # One free edge is enough to be open; to be closed both edges must be seen in the frame.
        if any(share >= AJAR for share in thing.free_edges):
            return State("open", True)
        return State("closed", True) if len(thing.free_edges) == 2 and max(thing.free_edges) < SHUT else None
    if thing.kind in CASES | VESSELS:
        if thing.hollow >= LOOKED_INTO:
            return State("open", not thing.cut)
        # From the side an open vessel looks like a closed one.
        return State("closed", not thing.cut) if thing.kind in CASES and thing.hollow < SOLID else None
    if thing.kind in CURTAINS:
        bare = any(
            other.kind == "window"
            and other.share >= BARE_WINDOW * thing.share
            and gap_m(view, place, index) <= CURTAIN_REACH_M
            for place, other in enumerate(view.things)
        )
        return State("open", True) if bare else State("closed", False)
    if thing.kind == "laptop":
        return State("open" if thing.size[1] >= LID_M else "closed", not thing.cut)
    return None


def _load(view: View, index: int) -> State | None:
    """Something on or in it makes it full; nothing seen there makes it empty, without certainty."""
    for other, thing in enumerate(view.things):
        if other != index and thing.kind not in STRUCTURE and (on(view, other, index) or inside(view, other, index)):
            return State("full", True)
    return State("empty", False)
