"""What stands in each kind of room."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.rooms.living import dining_room, hallway, living_room
from pipeline.scene.procedural.rooms.sleeping import bedroom, childrens_room, guest_room
from pipeline.scene.procedural.rooms.wet import bathroom, kitchen, laundry_room
from pipeline.scene.procedural.rooms.working import office

FURNISH: dict[str, Callable[[RoomPlacer], None]] = {
    "bathroom": bathroom,
    "bedroom": bedroom,
    "children's room": childrens_room,
    "dining room": dining_room,
    "guest room": guest_room,
    "hallway": hallway,
    "kitchen": kitchen,
    "laundry room": laundry_room,
    "living room": living_room,
    "office": office,
}
"""Furnisher of every kind of room."""

__all__ = ["FURNISH"]
