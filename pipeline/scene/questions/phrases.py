"""Unambiguous descriptions: every way the generator knows to single out an object of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.scene.questions.relations import RelationName
from pipeline.scene.questions.world import Phrase, Place, World

PLACES: tuple[RelationName, ...] = ("on", "in", "under", "behind", "above", "next to")
_FAR_M = 4.0
"""Distance over which nobody measures by eye which of two things is the nearer."""


class Describer:
    """Finds, and remembers, the descriptions that denote exactly one object."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.plain: dict[int, tuple[Phrase, ...]] = {i: tuple(self._plain(i)) for i in world.askable}
        """Descriptions without a place, shortest first: "bed", "red chair", "lamp in the kitchen"."""
        self._full: dict[int, tuple[Phrase, ...]] = {}
        self._named = [i for i in world.askable if self.plain[i]]
        self._volume, self._longest = world.layout.volume, world.layout.longest

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
        for anchor in self._named:
            if self.may_anchor(position, anchor):
                text = self.plain[anchor][0].text
                for place in places:
                    yield place, anchor, text

    def may_anchor(self, position: int, anchor: int) -> bool:
        """Return whether one would place the object by this anchor: another thing in its room, not a smaller one."""
        world = self.world
        if anchor == position or not world.same_room(position, anchor):
            return False
        if self._volume[anchor] < 0.3 * self._volume[position] and self._longest[anchor] < 0.8:
            return False
        return not any(world.relations.may_hold[name][anchor, position] for name in ("on", "in", "under", "behind"))

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
        has_rival = self._has_rival(position)
        for place, anchor, text in self.anchors(position, places=(*PLACES, "closest to", "farthest from")):
            if place in holds and not holds[place][position, anchor]:
                continue
            extreme = place not in holds
            if extreme and (not has_rival or self.world.layout.distance[position, anchor] > _FAR_M):
                continue
            phrase = Phrase(o.category, "", "", place, anchor, text)
            # The anchor's own room, where it is named, already says the target's.
            variants = [phrase, replace(phrase, color=color)] if color else [phrase]
            for variant in variants:
                if extreme and self.world.denotes_only(replace(variant, place="", anchor=-1), position):
                    continue
                if self.world.denotes_only(variant, position):
                    yield variant

    def _has_rival(self, position: int) -> bool:
        """Return whether another object of the category stands in the same room, so that an extreme says something."""
        category, world = self.world.objects[position].category, self.world
        return any(
            i != position and o.category == category and world.same_room(i, position)
            for i, o in enumerate(world.objects)
        )
