"""Describing a view, or one object in it, without a question: what the baselines of captions give a language model."""

from __future__ import annotations

from pipeline.models.symbolic.knowledge import BUILDING
from pipeline.models.symbolic.resolve import prominence, room_of
from pipeline.models.symbolic.sentences import ALWAYS_PLURAL, listed, place_of, with_article
from pipeline.models.symbolic.states import state_of
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View

SHOWS_NOTHING = "The picture shows nothing that can be made out."
MOST_THINGS = 12
"""Things placed one by one, the largest: about what a caption of four sentences holds."""
NEAR_M, FAR_M = 2.0, 4.0
"""Distances from the camera within which a thing is said to be close, and beyond which far away."""
LEFT, RIGHT = 1 / 3, 2 / 3
"""Shares of the image's width that bound its middle third."""


def caption(view: View) -> str:
    """Return a description of a view: its room, then its larger things with colour, side, place, distance and state.

    Walls, floors and ceilings are said in one breath at the end: they are in every view.

    Args:
        view: What is seen.
    """
    if not view.things:
        return SHOWS_NOTHING
    building = [thing for thing in view.things if thing.kind in BUILDING]
    furniture = [index for index, thing in enumerate(view.things) if thing.kind not in BUILDING]
    room = room_of(view)
    sentences = [f"This is the {room}."] if room else []
    sentences += [_placed(view, index) for index in furniture[:MOST_THINGS]]
    if rest := [view.things[index].name for index in furniture[MOST_THINGS:]]:
        sentences.append(f"Also seen: {listed(rest)}.")
    if kinds := sorted({(thing.name, thing.color) for thing in building}):
        sentences.append(f"Around it: {', '.join(f'{color} {name}' for name, color in kinds)}.")
    return " ".join(sentences)


def caption_object(view: View, name: str) -> str:
    """Return a sentence on the most prominent thing of a name: its colours, what it stands on or next to, its states.

    Args:
        view: What is seen, cut out around it.
        name: What it was taken for; what no thing of that name shows is not described.
    """
    found = view.named(frozenset({name}))
    if not found:
        return f"There is {with_article(name)}."
    return _placed(view, max(found, key=lambda i: (prominence(view.things[i]), -i)), aside=True)


def _placed(view: View, index: int, *, aside: bool = False) -> str:
    thing = view.things[index]
    place = place_of(view, index)
    where = f" {place[0]}" if place is not None else ""
    colors = " and ".join(color for color in (thing.color, thing.second_color) if color)
    noun, plural = f"{colors} {thing.name}".strip(), thing.name in ALWAYS_PLURAL
    verb, noun = ("are", noun) if plural else ("is", with_article(noun))
    doubt = "" if thing.clear else "what looks like "
    side, distance = ("There", "") if aside else (_side(thing), _distance(thing))
    return f"{side} {verb} {doubt}{noun}{where}{distance}{_states(view, index)}."


def _side(thing: Thing) -> str:
    across = thing.center[0]
    return "On the left" if across < LEFT else "On the right" if across > RIGHT else "In the middle"


def _distance(thing: Thing) -> str:
    return ", close by" if thing.distance < NEAR_M else ", far away" if thing.distance > FAR_M else ""


def _states(view: View, index: int) -> str:
    found = (state_of(view, index, scale) for scale in ("open", "on"))
    return "".join(f", {state.value}" for state in found if state is not None and state.sure)
