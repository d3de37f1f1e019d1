"""Putting small things on, in, under and behind furniture: into the slots its builder left free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.scene.procedural.furniture import BUILDERS
from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.things import Model, Placed, Slot, oriented_boxes_overlap

TRIES = 10
"""Positions tried for each thing."""
APART_M = 0.015
"""Least distance between things in one slot."""
TO_FRONT = 0.8
"""Share of things in cabinets that stand at the front edge, and of things under furniture that lie at an open side."""
LIFT_M = 0.001
"""Air under a thing: keeps its base from coinciding with what it stands on."""


def fill(
    placer: RoomPlacer,
    holder: Placed,
    relation: str,
    choices: Sequence[str],
    count: int,
    *,
    kind: str = "",
    turn: float = 0.3,
    nested: float = 0.5,
) -> list[Placed]:
    """Put up to `count` things into the slots of a placed thing and return those that fit.

    Args:
        placer: Room the holder is in.
        holder: The furniture.
        relation: Which slots: on, in, under or behind.
        choices: Builder names; each thing is one of them, without repeats while the list lasts.
        count: Things wanted over all these slots.
        kind: Kind of slot, as its builder named it.
        turn: Largest turn of a thing against the holder, radians.
        nested: Chance that a filled container gets something inside as well.
    """
    rng = placer.rng
    slots = [slot for slot in holder.model.slots if slot.relation == relation and slot.kind == kind]
    if not slots or not choices:
        return []
    placed: list[Placed] = []
    order = [choices[int(i)] for i in rng.permutation(len(choices))]
    for k in range(2 * count + 2):
        if len(placed) == count:
            break
        model = BUILDERS[order[k % len(order)]](rng)
        slot = slots[int(rng.integers(len(slots)))] if k else slots[(k + int(rng.integers(len(slots)))) % len(slots)]
        thing = put(placer, holder, slot, model, turn=turn)
        if thing is None:
            continue
        placed.append(thing)
        if rng.random() < nested:
            fill_container(placer, thing)
    return placed


SMALL_CONTENTS = ("ball", "bottle", "water_bottle", "toilet_roll", "decoration", "bottle")
LARGE_CONTENTS = (*SMALL_CONTENTS, "shoe", "book", "stuffed_animal", "water_pitcher", "bowl", "hat", "clothes", "purse")


def fill_container(placer: RoomPlacer, holder: Placed) -> None:
    """Put one or two things into an open container."""
    room_inside = [slot for slot in holder.model.slots if slot.relation == "in"]
    if not room_inside:
        return
    small = min(slot.high[0] - slot.low[0] for slot in room_inside) < 0.2
    choices = SMALL_CONTENTS if small else LARGE_CONTENTS
    fill(placer, holder, "in", choices, 1 if small else int(placer.rng.integers(1, 3)), nested=0.0, turn=0.2)


def put(placer: RoomPlacer, holder: Placed, slot: Slot, model: Model, *, turn: float) -> Placed | None:
    """Put one thing somewhere in a slot; None when it is too big or the slot is full."""
    low, high = np.array(slot.low), np.array(slot.high)
    on_floor = slot.relation in ("under", "behind")
    if model.size[2] > high[2] - low[2]:
        return None
    for _ in range(TRIES):
        yaw = float(placer.rng.uniform(-turn, turn))
        if on_floor and placer.rng.random() < 0.5:
            yaw += np.pi / 2
        trial = Placed(model, np.zeros(3), yaw, holder.room, -1)
        box = trial.box
        first, last = low[:2] - box[0, :2], high[:2] - box[1, :2]
        if (first > last).any():
            continue
        x, y = placer.rng.uniform(first, last)
        if slot.relation == "in" and placer.rng.random() < TO_FRONT:
            y = last[1]
        elif slot.relation == "under" and placer.rng.random() < TO_FRONT:
            # Towards an open side: left, right or front; the back may be a wall.
            side = int(placer.rng.integers(3))
            x, y = ((first[0], y), (last[0], y), (x, last[1]))[side]
        at = np.array([x, y, low[2] + LIFT_M - model.bounds[0][2]])
        floor = placer.surfaces["floor"]
        placed = Placed(
            model,
            holder.to_world(at),
            holder.yaw + yaw,
            holder.room,
            -1,
            holder.instance,
            slot.relation,
            host=floor if on_floor else holder.instance,
        )
        inside = all(placer.room.contains(float(x), float(y), 0.01) for x, y in placed.footprint)
        siblings = [thing for thing in placer.home.by_room[holder.room] if thing.parent == holder.instance]
        if not inside or any(oriented_boxes_overlap(placed, other, APART_M) for other in siblings):
            continue
        if placer.collides(placed, 0.005) or (on_floor and not placer.leaves_way(placed)):
            continue
        return placer.keep(placed)
    return None
