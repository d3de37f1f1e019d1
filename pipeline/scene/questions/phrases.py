"""Unambiguous descriptions: every way the generator knows to single out an object of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.scene.questions.relations import RelationName
from pipeline.scene.questions.world import Phrase, Place, World

PLACES: tuple[RelationName, ...] = ("on", "in", "under", "behind", "above", "next to")


class Describer:
    """Finds, and remembers, the descriptions that denote exactly one object."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.plain: dict[int, tuple[Phrase, ...]] = {i: tuple(self._plain(i)) for i in world.askable}
        """Descriptions without a place, shortest first: "bed", "red chair", "lamp in the kitchen"."""
        self._full: dict[int, tuple[Phrase, ...]] = {}

    def all(self, position: int) -> tuple[Phrase, ...]:
        """Return every clear description of an object: plain ones, then those that name a place."""
        if position not in self._full:
            self._full[position] = (*self.plain[position], *self._placed(position))
        return self._full[position]

    def shortest(self, position: int) -> Phrase | None:
        """Return the shortest plain description, or None where the object needs a place to be told apart."""
        plain = self.plain.get(position, ())
        return plain[0] if plain else None

    def pick(self, position: int, rng: np.random.Generator, *, colored: bool = True) -> Phrase | None:
        """Return one description, plain ones if there are any and extremes only at need, or None.

        Args:
            position: The object.
            rng: Source of the choice.
            colored: Whether the object's own colour may be named.
        """
        options = [p for p in self.all(position) if colored or not p.color]
        if not options:
            return None
        plain = [p for p in options if not p.place]
        related = [p for p in options if p.place in self.world.relations.holds]
        pools = [pool for pool in (plain, related) if pool] or [options]
        pool = pools[int(rng.random() < 0.2) if len(pools) > 1 else 0]
        return pool[int(rng.integers(len(pool)))]

    def anchors(self, position: int, *, places: tuple[Place, ...]) -> Iterator[tuple[Place, int, str]]:
        """Yield (place, anchor, anchor's description) for what may serve to place an object."""
        for anchor in self.world.askable:
            phrase = self.shortest(anchor)
            if phrase is None or not self.may_anchor(position, anchor):
                continue
            for place in places:
                yield place, anchor, phrase.text

    def may_anchor(self, position: int, anchor: int) -> bool:
        """Return whether one would place the object by this anchor: another thing in its room, not a smaller one."""
        world = self.world
        if anchor == position or not world.same_room(position, anchor):
            return False
        rests = any(world.relations.may_hold[name][anchor, position] for name in ("on", "in", "under", "behind"))
        volume = world.layout.volume
        return not rests and bool(volume[anchor] >= 0.3 * volume[position] or world.layout.longest[anchor] >= 0.8)

    def _plain(self, position: int) -> Iterator[Phrase]:
        o, room, color = self.world.objects[position], self.world.room_of[position], self.world.color_of(position)
        options = [Phrase(o.category)]
        if color:
            options.append(Phrase(o.category, color))
        if room:
            options.append(Phrase(o.category, room=room))
        if color and room:
            options.append(Phrase(o.category, color, room))
        for phrase in options:
            if self.world.denotes_only(phrase, position):
                yield phrase

    def _placed(self, position: int) -> Iterator[Phrase]:
        o, color, holds = self.world.objects[position], self.world.color_of(position), self.world.relations.holds
        for place, anchor, text in self.anchors(position, places=(*PLACES, "closest to", "farthest from")):
            if place in holds and not holds[place][position, anchor]:
                continue
            if place in ("closest to", "farthest from") and not self._has_rival(position):
                continue
            phrase = Phrase(o.category, "", "", place, anchor, text)
            # The anchor's own room, where it is named, already says the target's.
            variants = [phrase, replace(phrase, color=color)] if color else [phrase]
            for variant in variants:
                if self.world.denotes_only(variant, position):
                    yield variant

    def _has_rival(self, position: int) -> bool:
        """Return whether another object of the category stands in the same room, so that an extreme says something."""
        category, world = self.world.objects[position].category, self.world
        return any(
            i != position and o.category == category and world.same_room(i, position)
            for i, o in enumerate(world.objects)
        )
