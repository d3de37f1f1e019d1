"""A scene's objects ready for asking about: geometry, relations and rooms, and what a description denotes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.layout import Layout, measure_layout
from pipeline.scene.questions.names import STRUCTURE, be, may_be_called, plural, room_word
from pipeline.scene.questions.relations import DOORS, RelationName, Relations, find_relations, heads

Place = Literal["", "on", "in", "under", "behind", "above", "next to", "closest to", "farthest from"]
"""How a description places its object: a relation, or the extreme of a distance."""

VAGUE = frozenset({"object", "furniture", "structure", "machine", "unknown", "person", "decoration"})
"""Names too vague to ask for."""
UNCOLORED = frozenset(
    {"window", "mirror", "picture", "poster", "painting", "plant", "potted plant", "shower", "object"}
)
"""Categories whose colour a person would not name in one word."""

CLEARLY_NEARER = 1.4
"""Ratio of distances from which on one thing is plainly nearer than another..."""
CLEARLY_NEARER_M = 0.35
"""... and the least difference, metres."""

_SIMILAR_COLORS = (
    {"gray", "white"},
    {"gray", "black"},
    {"brown", "orange"},
    {"red", "pink"},
    {"red", "orange"},
    {"yellow", "orange"},
    {"purple", "pink"},
    {"purple", "blue"},
    {"brown", "red"},
    {"blue", "gray"},
    {"green", "blue"},
)


@runtime_checkable
class Room(Protocol):
    """A named room; procedural scenes know theirs."""

    @property
    def name(self) -> str:
        """Name such as "kitchen" or "bedroom 2", as `SceneObject.room` has it."""
        ...

    @property
    def low(self) -> tuple[float, float]:
        """Lowest x and y of the floor, metres."""
        ...

    @property
    def high(self) -> tuple[float, float]:
        """Highest x and y of the floor, metres."""
        ...


@dataclass(frozen=True, slots=True)
class Phrase:
    """A description of one object or a group: category, perhaps colour, room, and a place relative to an anchor."""

    category: str
    """Category name."""
    color: str = ""
    """Basic colour name; empty for none."""
    room: str = ""
    """Room as a person says it; empty for none."""
    place: Place = ""
    """Relation to the anchor; empty for none."""
    anchor: int = -1
    """Position of the anchor in the world's objects; -1 for none."""
    anchor_text: str = ""
    """The anchor's own description, without article."""

    @property
    def noun(self) -> str:
        """Colour and category: "red chair"."""
        return f"{self.color} {self.category}".strip()

    @property
    def where(self) -> str:
        """Place and room: "on the desk in the kitchen"; empty where neither is given."""
        parts = [
            f"{self.place} the {self.anchor_text}" if self.place else "",
            f"in the {self.room}" if self.room else "",
        ]
        return " ".join(part for part in parts if part)

    @property
    def text(self) -> str:
        """The whole description without an article: "red chair next to the bed"."""
        return f"{self.noun} {self.where}".strip()

    @property
    def nouns(self) -> str:
        """Colour and category in the plural: "red chairs"."""
        return f"{self.color} {plural(self.category)}".strip()

    @property
    def be(self) -> str:
        """The verb that goes with it, is or are."""
        return be(self.category)


@dataclass(frozen=True, slots=True)
class World:
    """Objects, geometry and relations of one scene; arrays are indexed by position in `objects`."""

    objects: tuple[SceneObject, ...]
    """All objects, structure included, in the order given."""
    layout: Layout
    """Pairwise geometry."""
    relations: Relations
    """Pairwise relations."""
    rooms: tuple[str, ...]
    """Distinct room words, sorted."""
    floors: Mapping[str, tuple[tuple[float, float], tuple[float, float]]]
    """Floor rectangle (lowest and highest x, y; metres) of each room of known extent, by the room's full name."""
    room_of: tuple[str, ...]
    """Room word of each object; empty when unknown, and for doors."""
    askable: tuple[int, ...]
    """Positions of objects one may ask about: no structure, nothing vague."""
    _known: dict[object, Bool[np.ndarray, "n"]] = field(default_factory=dict, repr=False, compare=False)
    """Readings worked out before; descriptions come back thousands of times."""

    @property
    def is_askable(self) -> Bool[np.ndarray, "n"]:
        """Which objects one may ask about."""
        result = np.zeros(len(self.objects), bool)
        result[list(self.askable)] = True
        return result

    def denotes(self, phrase: Phrase, *, lenient: bool = False) -> Bool[np.ndarray, "n"]:
        """Return which objects the description fits, in the strict sense or in the one nobody would deny."""
        fits = self._kind(phrase.category, phrase.color, phrase.room, lenient)
        if phrase.place in ("closest to", "farthest from"):
            return fits & self._extreme(phrase, lenient)
        if phrase.place:
            table = self.relations.may_hold if lenient else self.relations.holds
            return fits & table[phrase.place][:, phrase.anchor]
        return fits

    def is_clear(self, phrase: Phrase) -> bool:
        """Return whether strict and lenient readings denote the same objects, at least one."""
        strict = self.denotes(phrase)
        return bool(strict.any() and (strict == self.denotes(phrase, lenient=True)).all())

    def denotes_only(self, phrase: Phrase, position: int) -> bool:
        """Return whether the description fits this object and no other, however it is read."""
        strict = self.denotes(phrase)
        return bool(strict[position] and strict.sum() == 1 and self.denotes(phrase, lenient=True).sum() == 1)

    def nearer(self, anchor: int, near: int, far: int, *, ratio: float = CLEARLY_NEARER) -> bool:
        """Return whether `near` is plainly nearer to `anchor` than `far` is, by boxes and by centres."""
        for distance in (self.layout.distance[anchor], self.layout.center_distance[anchor]):
            if distance[far] < max(ratio * distance[near], distance[near] + CLEARLY_NEARER_M):
                return False
        return True

    def colors_alike(self, first: str, second: str) -> bool:
        """Return whether one colour may be taken for the other; an unnamed colour may be taken for any."""
        return first == second or "" in (first, second) or {first, second} in _SIMILAR_COLORS

    def same_room(self, *positions: int) -> bool:
        """Return whether the objects may all be in one room; a door, or a thing of unknown room, is in any."""
        return len({self.room_of[i] for i in positions} - {""}) <= 1

    def stature(self, position: int) -> float:
        """Return how tall an object is, metres: from the floor up for what stands on it, since scans miss legs."""
        bottom, top = self.layout.bottom, self.layout.top
        floor = min(float(bottom[i]) for i in self.askable)
        stands = not self.relations.rests[position] and bottom[position] <= floor + 0.6
        return float(top[position] - (floor if stands else bottom[position]))

    def color_of(self, position: int) -> str:
        """Return the object's colour, or "" where naming it makes no sense."""
        o = self.objects[position]
        return "" if o.category in UNCOLORED else o.color

    def _kind(self, category: str, color: str, room: str, lenient: bool) -> Bool[np.ndarray, "n"]:
        key = (category, color, room, lenient)
        if key in self._known:
            return self._known[key]
        self._known[key] = np.array(
            [
                (may_be_called(o.category, category) if lenient else o.category == category)
                and (not color or o.color == color or (lenient and not self.color_of(i)))
                and (not room or self.room_of[i] == room or (lenient and not self.room_of[i]))
                for i, o in enumerate(self.objects)
            ],
            bool,
        )
        return self._known[key]

    def _extreme(self, phrase: Phrase, lenient: bool) -> Bool[np.ndarray, "n"]:
        """Return the one object plainly nearest to (farthest from) the anchor; none where it is not plain.

        Distances through walls mean little to a person: the extreme lies in the anchor's room, and for the farthest
        no rival may be elsewhere.
        """
        key = (phrase, lenient)
        if key in self._known:
            return self._known[key]
        rivals = self._kind(phrase.category, phrase.color, phrase.room, True).copy()
        rivals[phrase.anchor] = False
        self._known[key] = self._most(phrase, rivals, lenient)
        return self._known[key]

    def _most(self, phrase: Phrase, rivals: Bool[np.ndarray, "n"], lenient: bool) -> Bool[np.ndarray, "n"]:
        positions = np.flatnonzero(rivals)
        result = np.zeros(len(self.objects), bool)
        if not len(positions):
            return result
        distance = self.layout.distance[phrase.anchor, positions]
        farthest = phrase.place == "farthest from"
        best = int(positions[distance.argmax() if farthest else distance.argmin()])
        plain = all(
            self.nearer(phrase.anchor, int(other), best) if farthest else self.nearer(phrase.anchor, best, int(other))
            for other in positions
            if other != best
        )
        plain &= self.same_room(phrase.anchor, *(positions.tolist() if farthest else [best]))
        if plain:
            result[best] = True
        elif lenient:
            result[positions] = True
        return result


def build_world(objects: Sequence[SceneObject], rooms: Sequence[Room]) -> World:
    """Return the world of a scene's objects.

    Args:
        objects: Every object, structure included; empty where nothing is known.
        rooms: The scene's rooms, to know of those without objects; may be empty.
    """
    layout = measure_layout(objects)
    relations = find_relations(objects, layout)
    # A door belongs to the rooms on both its sides.
    doors = heads(objects, DOORS)
    room_of = tuple("" if door else room_word(o.room) for o, door in zip(objects, doors, strict=True))
    names = sorted({room_word(r.name) for r in rooms} | {name for name in room_of if name})
    askable = tuple(i for i, o in enumerate(objects) if o.category not in STRUCTURE | VAGUE)
    floors = {r.name: (r.low, r.high) for r in rooms}
    return World(tuple(objects), layout, relations, tuple(names), floors, room_of, askable)


def relation_targets(world: World, relation: RelationName, anchor: int) -> tuple[list[int], list[int]]:
    """Return the objects that stand so to the anchor, strictly and leniently, as positions."""
    strict = np.flatnonzero(world.relations.holds[relation][:, anchor])
    lenient = np.flatnonzero(world.relations.may_hold[relation][:, anchor])
    return strict.tolist(), lenient.tolist()
