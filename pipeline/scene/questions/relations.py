"""Which object stands how to which, from oriented boxes and, where a scene says so, from its construction.

Every relation is known twice: `holds` is what a careful person would affirm, `may_hold` what nobody would deny.
A description is unambiguous when exactly one object satisfies it in the first sense and no other in the second,
so a borderline case never decides an answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.layout import Layout
from pipeline.scene.questions.names import STRUCTURE, names

RelationName = Literal["on", "in", "under", "behind", "above", "next to"]

FLAT_SUPPORTS = names(
    "table, desk, counter, nightstand, cabinet, dresser, stool, refrigerator, microwave, box, bench, stand, ottoman, "
    "dryer, printer, piano, toilet, windowsill, radiator"
)
"""Categories (by last word) with a top one puts things on."""
SOFT_SUPPORTS = names("bed, couch, sofa, chair, armchair, seat, mattress, shelf, bookshelf, rack, cart, crib")
"""Categories whose box rises above the place one puts things on: head boards, back rests, upper shelves."""
COVERS = names("bed, table, desk, counter, chair, bench, couch, piano, shelf, nightstand, crib")
"""Categories one can put things under."""
CONTAINERS = names("basket, bin, can, trashcan, box, crate, cabinet, sink, bathtub, refrigerator, bag, bucket, bowl")
"""Categories one can put things in."""

OPEN_INSIDES = names("shelf, bookshelf, rack, sink, basket, tray, bed, couch, armchair")
"""Categories for which "in" and "on" are used alike."""
DOORS = frozenset({"door", "doorframe"})
"""Categories that belong to the rooms on both their sides."""

NEXT_TO_M = 0.45
"""Gap up to which two pieces of furniture stand next to each other."""
NEXT_TO_SMALL_M = 0.25
"""The same for things smaller than `SMALL_M`."""
NEXT_TO_MAYBE_M = 0.9
"""Gap beyond which nobody says "next to"."""
SMALL_M = 0.5
"""Longest side of a small thing."""


@dataclass(frozen=True, slots=True)
class Relations:
    """Relations among n objects; entry [i, j] says how object i stands to object j."""

    holds: dict[str, Bool[np.ndarray, "n n"]]
    """Strict sense."""
    may_hold: dict[str, Bool[np.ndarray, "n n"]]
    """Lenient sense; contains the strict one."""
    rests: Bool[np.ndarray, "n"]
    """Which objects lie on or in another one."""
    constructed: bool
    """Whether the scene states what stands on what; boxes alone decide otherwise."""
    complete: bool
    """Whether all that is there is known, so that "nothing is there" is true. Generated scenes know their rooms and
    all their things; a scan's annotators left things out."""


def find_relations(objects: Sequence[SceneObject], layout: Layout) -> Relations:
    """Return all pairwise relations.

    Args:
        objects: All objects of a scene, structure included.
        layout: Their geometry.
    """
    constructed = any(o.parent >= 0 and o.relation for o in objects)
    stated = _stated(objects)
    things = np.array([o.category not in STRUCTURE for o in objects], bool)
    pair = things[:, None] & things[None] & ~np.eye(len(objects), dtype=bool)
    pair &= _same_room(objects)
    geometric, may = _geometric(objects, layout)
    holds: dict[str, Bool[np.ndarray, "n n"]] = {}
    may_hold: dict[str, Bool[np.ndarray, "n n"]] = {}
    has_parent = np.array([o.parent >= 0 for o in objects], bool)[:, None]
    for name in ("on", "in", "under"):
        strict = stated[name] if constructed else geometric[name]
        # A thing that stands on one object by construction is not in or under another in the strict sense.
        holds[name] = strict & pair
        may_hold[name] = (may[name] & ~(constructed & has_parent & _of_parent(objects)) | stated[name]) & pair
        may_hold[name] |= holds[name] | _through(stated[name], stated["on"]) & pair
    # A sink in the counter may be said to be on it.
    may_hold["on"] = may_hold["on"] | holds["in"]
    may_hold["in"] = may_hold["in"] | holds["on"] & heads(objects, OPEN_INSIDES)[None]
    holds["behind"] = stated["behind"] & pair
    may_hold["behind"] = holds["behind"] | _behind(stated["behind"], layout) & pair
    resting = np.logical_or.reduce([may_hold[n] | may_hold[n].T for n in ("on", "in", "under")])
    over = layout.bottom[:, None] - layout.top[None]
    column = (layout.near >= 0.6) & (over >= -0.05)
    hanging = (layout.longest >= 0.2)[:, None] & ~(holds["on"] | holds["in"]).any(axis=1)[:, None]
    clear = ~_something_between(layout, column & pair)
    holds["above"] = column & (over <= 1.5) & (over >= 0.0) & (layout.near >= 0.8) & hanging & clear & ~resting & pair
    may_hold["above"] = (column | (layout.near >= 0.3) & (over >= -0.3)) & pair
    small = layout.longest < SMALL_M
    reach = np.where(small[:, None] & small[None], NEXT_TO_SMALL_M, NEXT_TO_M)
    beside = (layout.vertical_gap <= 0.05) & (layout.overlap < 0.3) & (layout.overlap.T < 0.3)
    holds["next to"] = (layout.gap <= reach) & beside & _same_level(objects, layout, holds) & ~resting & pair
    may_hold["next to"] = (layout.gap <= NEXT_TO_MAYBE_M) & (layout.vertical_gap <= 0.6) & pair | holds["next to"]
    rests = (holds["on"] | holds["in"]).any(axis=1)
    return Relations(holds, may_hold, rests, constructed, constructed and any(o.room for o in objects))


def heads(objects: Sequence[SceneObject], words: frozenset[str]) -> Bool[np.ndarray, "n"]:
    """Return which objects' category, by its last word, is among `words`."""
    return np.array([o.category in words or o.category.rsplit(" ", 1)[-1] in words for o in objects], bool)


def _stated(objects: Sequence[SceneObject]) -> dict[str, Bool[np.ndarray, "n n"]]:
    index = {o.instance: i for i, o in enumerate(objects)}
    stated = {name: np.zeros((len(objects), len(objects)), bool) for name in ("on", "in", "under", "behind")}
    for i, o in enumerate(objects):
        if o.relation and o.parent in index:
            stated[o.relation][i, index[o.parent]] = True
    return stated


def _of_parent(objects: Sequence[SceneObject]) -> Bool[np.ndarray, "n n"]:
    """Return [i, j] true where j is the stated parent of i, whose relation is then known for certain."""
    parents = np.array([o.parent for o in objects])[:, None]
    return parents == np.array([o.instance for o in objects])[None]


def _through(stated: Bool[np.ndarray, "n n"], on: Bool[np.ndarray, "n n"]) -> Bool[np.ndarray, "n n"]:
    """Return what holds by way of a thing in between: a cup on a book on the desk may be said to be on the desk."""
    return (on.astype(np.uint8) @ stated.astype(np.uint8)) > 0


def _same_room(objects: Sequence[SceneObject]) -> Bool[np.ndarray, "n n"]:
    rooms = np.array(["" if door else o.room for o, door in zip(objects, heads(objects, DOORS), strict=True)])
    return (rooms[:, None] == rooms[None]) | (rooms[:, None] == "") | (rooms[None] == "")


def _geometric(
    objects: Sequence[SceneObject], layout: Layout
) -> tuple[dict[str, Bool[np.ndarray, "n n"]], dict[str, Bool[np.ndarray, "n n"]]]:
    flat, soft = heads(objects, FLAT_SUPPORTS)[None], heads(objects, SOFT_SUPPORTS)[None]
    cover, container = heads(objects, COVERS)[None], heads(objects, CONTAINERS)[None]
    bottom, top, volume = layout.bottom, layout.top, layout.volume
    lift = bottom[:, None] - bottom[None]
    over = bottom[:, None] - top[None]
    height = (top - bottom)[None]
    smaller = volume[:, None] < 0.8 * volume[None]
    flat_on = flat & (np.abs(over) <= 0.12) & (lift > 0.2)
    soft_on = soft & (lift >= 0.2) & (lift >= 0.25 * height) & (over <= 0.06) & smaller
    strict_on = (flat_on | soft_on) & (layout.overlap >= 0.6)
    maybe_on = (flat | soft) & (lift >= 0.15) & (over <= 0.3) & (layout.overlap >= 0.25)
    low = (lift <= 0.15) & (top[:, None] <= top[None] - 0.08) | (top[:, None] <= bottom[None] + 0.1)
    strict_under = cover & low & smaller & (layout.overlap >= 0.6)
    maybe_under = cover & (layout.overlap >= 0.2) & (top[:, None] <= top[None] + 0.05)
    shared = np.minimum(top[:, None], top[None]) - np.maximum(bottom[:, None], bottom[None])
    inside = layout.overlap * np.clip(shared / np.maximum(1e-6, (top - bottom)[:, None]), 0.0, 1.0)
    strict_in = container & (inside >= 0.9) & (volume[:, None] < 0.5 * volume[None])
    maybe_in = (container | soft) & (inside >= 0.4)
    return {"on": strict_on, "in": strict_in, "under": strict_under}, {
        "on": maybe_on | strict_on,
        "in": maybe_in | strict_in,
        "under": maybe_under | strict_under,
    }


def _something_between(layout: Layout, column: Bool[np.ndarray, "n n"]) -> Bool[np.ndarray, "n n"]:
    """Return which [i, j], i over j, have a third thing over j and under i."""
    tall = (layout.top - layout.bottom) > 0.05
    chain = (column & tall[None]).astype(np.uint8) @ (column & tall[:, None]).astype(np.uint8)
    return chain > 0


def _behind(stated: Bool[np.ndarray, "n n"], layout: Layout) -> Bool[np.ndarray, "n n"]:
    """Return what else stands on the side of an object where something is known to be behind it."""
    result = np.zeros_like(stated)
    for i, j in np.argwhere(stated):
        side: Float[np.ndarray, "2"] = layout.center[i, :2] - layout.center[j, :2]
        side = side / max(1e-9, float(np.linalg.norm(side)))
        depth = (layout.center[:, :2] - layout.center[j, :2]) @ side
        across = np.abs((layout.center[:, :2] - layout.center[j, :2]) @ np.array([-side[1], side[0]]))
        extent = layout.extent(np.array([-side[1], side[0]]))
        within = across - extent < extent[j] + 0.2
        result[:, j] |= (
            within & (depth > 0.3 * (layout.center[i, :2] - layout.center[j, :2]) @ side) & (layout.gap[:, j] < 0.8)
        )
    return result


def _same_level(
    objects: Sequence[SceneObject], layout: Layout, holds: dict[str, Bool[np.ndarray, "n n"]]
) -> Bool[np.ndarray, "n n"]:
    """Return which pairs stand on the same thing: both on one object, or neither on any."""
    support = np.full(len(objects), -1)
    for name in ("on", "in"):
        matrix = holds[name]
        support = np.where(matrix.any(axis=1), matrix.argmax(axis=1), support)
    same = support[:, None] == support[None]
    levels = np.abs(layout.bottom[:, None] - layout.bottom[None]) <= 0.4
    return same & (levels | (support >= 0)[:, None])
