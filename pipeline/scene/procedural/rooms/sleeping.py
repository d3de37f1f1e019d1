"""Bedrooms."""

from __future__ import annotations

from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.rooms.common import (
    SHELF_THINGS,
    TABLE_THINGS,
    UNDER_BED,
    UNDER_TABLE,
    against,
    chance,
    finish,
    hang,
    make,
    put_behind,
    put_in,
    put_on,
    put_under,
    rug,
    stand,
)
from pipeline.scene.procedural.things import Placed

WARDROBE_THINGS = ("clothes", "clothes", "clothes", "hat", "box", "bag", "shoe", "basket")


def _bed(placer: RoomPlacer) -> Placed | None:
    bed = against(placer, "bed", front=0.5)
    if bed:
        wide = bed.model.size[0] > 1.2
        put_on(placer, bed, ("pillow",), 2 if wide else 1, "pillow")
        put_on(placer, bed, ("blanket",), 1, "blanket")
        put_on(placer, bed, ("book", "laptop", "stuffed_animal", "clothes", "headphones", "purse", "hat"), 2)
        put_under(placer, bed, UNDER_BED, 4)
        hang(placer, "picture", (1.3, 1.5), above=bed)
    return bed


def bedroom(placer: RoomPlacer) -> None:
    """Bed with nightstands, wardrobe, dresser."""
    bed = _bed(placer)
    for _ in range(2):
        if bed:
            night = placer.beside(bed, make(placer, "nightstand"))
            put_on(placer, night, ("table_lamp", "alarm_clock", "book", "cup", "telephone"), 2)
            put_in(placer, night, ("book", "tissue_box", "cup"), 1)
    put_in(placer, against(placer, "wardrobe", front=0.5), WARDROBE_THINGS, 4)
    dresser = against(placer, "dresser")
    put_on(placer, dresser, ("table_lamp", "candle", "box", "plant", "hat", "tissue_box", "basket"), 3)
    hang(placer, "mirror", (1.05, 1.15), above=dresser)
    seat = against(placer, "armchair", gap=0.45)
    put_behind(placer, seat)
    put_on(placer, seat, ("cushion", "clothes", "bag"), 1, "seat")
    stand(placer, "laundry_basket", "potted_plant", "shoe", "fan", "suitcase", "floor_lamp")
    rug(placer, (1.1, 0.7), near=bed, distance=0.1)
    hang(placer, "picture", (1.2, 1.5))
    put_on(placer, hang(placer, "shelf", (1.2, 1.4)), SHELF_THINGS, 3)
    hang(placer, "clock", (1.6, 1.9))
    finish(placer)


def childrens_room(placer: RoomPlacer) -> None:
    """Bed, toys, a small table."""
    rng = placer.rng
    bed = _bed(placer)
    table = against(placer, "table")
    if table:
        placer.around(table, lambda: make(placer, "chair"), 2)
    put_on(placer, table, ("book", "ball", "laptop", "box", "cup", "paper", "stuffed_animal"), 3)
    put_under(placer, table, UNDER_TABLE, 1)
    put_in(placer, against(placer, "bookshelf"), (*SHELF_THINGS, "ball", "stuffed_animal"), 7)
    put_in(placer, against(placer, "wardrobe"), WARDROBE_THINGS, 3)
    for _ in range(2):
        stand(placer, "ball", "box", "stuffed_animal", "crate")
    stand(placer, "guitar", "backpack", "stool", "basket")
    if chance(placer, 0.5):
        put_under(placer, against(placer, "keyboard_piano"), ("ball", "box", "crate"), 1)
    rug(placer, (1.2, 1.0), near=bed, distance=0.1)
    for _ in range(int(rng.integers(1, 3))):
        hang(placer, "poster", (1.1, 1.4))
    put_on(placer, hang(placer, "shelf", (1.2, 1.4)), SHELF_THINGS, 3)
    finish(placer)


def guest_room(placer: RoomPlacer) -> None:
    """Bed, nightstand, luggage, a small desk."""
    bed = _bed(placer)
    if bed:
        put_on(placer, placer.beside(bed, make(placer, "nightstand")), ("table_lamp", "book", "alarm_clock"), 2)
    table = against(placer, "table")
    put_on(placer, table, TABLE_THINGS, 2)
    put_under(placer, table, UNDER_TABLE, 1)
    put_in(placer, against(placer, "wardrobe"), WARDROBE_THINGS, 3)
    seat = against(placer, "armchair", gap=0.45)
    put_behind(placer, seat)
    stand(placer, "suitcase", "suitcase", "potted_plant", "chair", "bag", "fan")
    rug(placer, (1.2, 0.8))
    hang(placer, "picture", (1.2, 1.5))
    hang(placer, "mirror", (0.9, 1.1))
    finish(placer)
