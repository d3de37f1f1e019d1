"""A small furnished home with known relations, for the question tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.objects import Relation, SceneObject


@dataclass(frozen=True, slots=True)
class HomeRoom:
    name: str
    low: tuple[float, float]
    high: tuple[float, float]


ROOMS = (
    HomeRoom("bedroom", (0.05, 0.05), (3.95, 3.95)),
    HomeRoom("kitchen", (4.05, 0.05), (7.95, 3.95)),
    HomeRoom("living room", (0.05, 4.05), (3.95, 7.95)),
    HomeRoom("office", (4.05, 4.05), (7.95, 7.95)),
)


class Furnisher:
    """Adds boxes by centre on the floor plan, height of the bottom, and size."""

    def __init__(self) -> None:
        self.objects: list[SceneObject] = []

    def add(
        self,
        room: str,
        category: str,
        color: str,
        at: tuple[float, float, float],
        size: tuple[float, float, float],
        states: tuple[str, ...] = (),
        parent: int = -1,
        relation: Relation = "",
    ) -> int:
        x, y, bottom = at
        half = (size[0] / 2, size[1] / 2, size[2] / 2)
        self.objects.append(
            SceneObject(
                len(self.objects), category, color, (x, y, bottom + half[2]), half, 0.0, room, states, parent, relation
            )
        )
        return len(self.objects) - 1


def build_home() -> tuple[SceneObject, ...]:
    """Return the objects of four rooms; what stands on, in, under and behind what is stated."""
    f = Furnisher()
    f.add("", "floor", "brown", (4.0, 4.0, -0.1), (8.0, 8.0, 0.1))
    f.add("", "wall", "white", (4.0, 4.0, 0.0), (0.1, 8.0, 2.6))

    bed = f.add("bedroom", "bed", "blue", (1.2, 2.9, 0), (1.6, 2.0, 0.6))
    f.add("bedroom", "pillow", "white", (0.9, 3.6, 0.55), (0.5, 0.3, 0.15), (), bed, "on")
    f.add("bedroom", "pillow", "white", (1.5, 3.6, 0.55), (0.5, 0.3, 0.15), (), bed, "on")
    f.add("bedroom", "backpack", "red", (1.2, 2.6, 0.55), (0.35, 0.3, 0.4), (), bed, "on")
    f.add("bedroom", "box", "green", (1.2, 2.5, 0), (0.4, 0.4, 0.25), ("closed",), bed, "under")
    stand = f.add("bedroom", "nightstand", "brown", (2.3, 3.7, 0), (0.45, 0.45, 0.5), ("closed",))
    f.add("bedroom", "lamp", "yellow", (2.3, 3.7, 0.5), (0.2, 0.2, 0.4), ("on",), stand, "on")
    f.add("bedroom", "wardrobe", "white", (3.6, 1.0, 0), (0.6, 1.4, 2.1), ("open",))
    f.add("bedroom", "window", "", (0.05, 1.2, 1.0), (0.1, 1.2, 1.1))
    f.add("bedroom", "chair", "green", (0.5, 0.5, 0), (0.5, 0.5, 0.9))

    f.add("kitchen", "refrigerator", "white", (7.6, 3.5, 0), (0.7, 0.7, 1.8), ("closed",))
    counter = f.add("kitchen", "counter", "gray", (7.65, 1.8, 0), (0.6, 2.2, 0.9))
    f.add("kitchen", "sink", "gray", (7.65, 1.2, 0.7), (0.5, 0.5, 0.2), (), counter, "in")
    f.add("kitchen", "microwave", "black", (7.65, 2.5, 0.9), (0.4, 0.5, 0.3), ("closed",), counter, "on")
    table = f.add("kitchen", "dining table", "brown", (5.7, 2.0, 0), (0.9, 1.6, 0.75))
    f.add("kitchen", "bowl", "red", (5.7, 2.2, 0.75), (0.2, 0.2, 0.1), (), table, "on")
    for x, y in ((5.1, 1.6), (5.1, 2.4), (6.3, 1.6), (6.3, 2.4)):
        f.add("kitchen", "chair", "black", (x, y, 0), (0.45, 0.45, 0.9))
    f.add("kitchen", "stove", "black", (7.65, 0.35, 0), (0.6, 0.5, 0.9), ("off",))
    f.add("kitchen", "trash can", "gray", (4.5, 3.7, 0), (0.35, 0.35, 0.5))

    couch = f.add("living room", "couch", "gray", (1.0, 6.0, 0), (0.9, 2.2, 0.85))
    f.add("living room", "pillow", "orange", (0.8, 6.5, 0.45), (0.3, 0.45, 0.3), (), couch, "on")
    f.add("living room", "ball", "purple", (0.3, 6.0, 0), (0.25, 0.25, 0.25), (), couch, "behind")
    low_table = f.add("living room", "coffee table", "brown", (2.2, 6.0, 0), (0.6, 1.1, 0.45))
    f.add("living room", "book", "blue", (2.2, 6.2, 0.45), (0.2, 0.3, 0.06), (), low_table, "on")
    tv_stand = f.add("living room", "tv stand", "black", (3.7, 6.0, 0), (0.45, 1.6, 0.5))
    f.add("living room", "tv", "black", (3.7, 6.0, 0.5), (0.1, 1.2, 0.7), ("off",), tv_stand, "on")
    f.add("living room", "plant", "green", (0.5, 7.6, 0), (0.4, 0.4, 1.2))
    f.add("living room", "picture", "red", (3.9, 6.0, 1.6), (0.05, 1.0, 0.7))

    desk = f.add("office", "desk", "brown", (6.0, 7.55, 0), (1.5, 0.7, 0.75))
    f.add("office", "laptop", "gray", (6.0, 7.6, 0.75), (0.35, 0.25, 0.25), ("open",), desk, "on")
    f.add("office", "lamp", "red", (6.6, 7.7, 0.75), (0.2, 0.2, 0.4), ("off",), desk, "on")
    f.add("office", "trash can", "black", (6.5, 7.6, 0), (0.3, 0.3, 0.4), (), desk, "under")
    f.add("office", "office chair", "black", (6.0, 6.9, 0), (0.6, 0.6, 1.1))
    f.add("office", "bookshelf", "brown", (4.25, 7.0, 0), (0.35, 1.2, 2.0))
    f.add("office", "backpack", "blue", (7.6, 7.2, 0), (0.3, 0.35, 0.45))
    return tuple(f.objects)


def quarter_turn(objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    """Return the home turned by 90 degrees about the vertical axis."""
    return tuple(replace(o, center=(-o.center[1], o.center[0], o.center[2]), yaw=o.yaw + np.pi / 2) for o in objects)


def mirrored(objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    """Return the home as in a mirror: left and right change places, nothing else does."""
    return tuple(replace(o, center=(-o.center[0], o.center[1], o.center[2]), yaw=-o.yaw) for o in objects)


def quarter_turn_rooms() -> tuple[HomeRoom, ...]:
    return tuple(HomeRoom(r.name, (-r.high[1], r.low[0]), (-r.low[1], r.high[0])) for r in ROOMS)


def mirrored_rooms() -> tuple[HomeRoom, ...]:
    return tuple(HomeRoom(r.name, (-r.high[0], r.low[1]), (-r.low[0], r.high[1])) for r in ROOMS)
