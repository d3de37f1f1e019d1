"""Living room, dining room and hallway."""

from __future__ import annotations

from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.rooms.common import (
    CABINET_THINGS,
    SHELF_THINGS,
    TABLE_THINGS,
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
from pipeline.scene.procedural.walls import SIDES


def living_room(placer: RoomPlacer) -> None:
    """Couch with a coffee table, television opposite, shelves, seats."""
    rng = placer.rng
    couch = placer.against_wall(make(placer, "couch"), gap=0.5 if chance(placer, 0.75) else 0.05, front=0.9)
    couch = couch or against(placer, "armchair", gap=0.45)
    facing = [side for side in SIDES if couch and abs(abs(side.yaw - couch.yaw) - 3.1416) < 0.01]
    stand_ = placer.against_wall(make(placer, "tv_stand"), sides=facing or SIDES, front=0.5)
    put_on(placer, stand_, ("tv",), 1, turn=0.05)
    put_in(placer, stand_, ("books", "box", "speaker", "basket", "telephone", "headphones"), 2)
    put_on(placer, stand_, ("speaker", "plant", "candle"), 1)
    if couch:
        table = placer.in_front(couch, make(placer, "coffee_table"), gap=0.34)
        put_on(placer, table, TABLE_THINGS, int(rng.integers(2, 4)))
        put_under(placer, table, ("ball", "shoe", "basket", "book"), 2)
        side = placer.beside(couch, make(placer, "end_table"))
        put_on(placer, side, ("table_lamp", "plant", "telephone", "alarm_clock"), 1)
        put_on(placer, couch, ("cushion", "cushion", "cushion", "book", "headphones", "stuffed_animal"), 2, "seat")
        put_behind(placer, couch, count=2)
        hang(placer, "picture", (1.3, 1.5), above=couch)
    for _ in range(2):
        seat = against(placer, "armchair", gap=0.46 if chance(placer, 0.7) else 0.08)
        put_behind(placer, seat)
        put_on(placer, seat, ("cushion", "book", "hat", "purse"), 1, "seat")
    put_in(placer, against(placer, "bookshelf"), SHELF_THINGS, 8)
    cabinet = against(placer, "cabinet")
    put_in(placer, cabinet, CABINET_THINGS, 3)
    put_on(placer, cabinet, TABLE_THINGS, 2)
    if chance(placer, 0.4):
        put_on(placer, against(placer, "fireplace"), ("candle", "plant", "decoration"), 2)
    if chance(placer, 0.35):
        put_on(placer, against(placer, "piano"), ("books", "table_lamp", "plant"), 2)
    stand(placer, "floor_lamp", "potted_plant", "ottoman", "basket", "guitar", "potted_plant")
    rug(placer, (1.5, 1.0))
    for _ in range(2):
        put_on(placer, hang(placer, "shelf", (1.15, 1.35)), SHELF_THINGS, 3)
    hang(placer, "clock", (1.6, 1.9))
    hang(placer, "picture", (1.2, 1.5))
    hang(placer, "poster", (1.1, 1.3))
    finish(placer)


def dining_room(placer: RoomPlacer) -> None:
    """Big table with chairs, a sideboard."""
    rng = placer.rng
    table = placer.anywhere(make(placer, "dining_table"), edge=False) or against(placer, "table")
    if table:
        placer.around(table, lambda: make(placer, "chair"), int(rng.integers(3, 6)))
    put_on(placer, table, ("plate", "plate", "bowl", "cup", "candle", "water_pitcher", "bottle"), 4)
    put_under(placer, table, UNDER_TABLE, 2)
    for _ in range(2):
        cabinet = against(placer, "cabinet")
        put_in(placer, cabinet, CABINET_THINGS, 3)
        put_on(placer, cabinet, TABLE_THINGS, 2)
    put_on(placer, against(placer, "dresser"), TABLE_THINGS, 2)
    if chance(placer, 0.5):
        put_on(placer, against(placer, "piano"), ("books", "candle", "plant"), 2)
    seat = against(placer, "armchair", gap=0.45)
    put_behind(placer, seat)
    stand(placer, "potted_plant", "floor_lamp", "stool", "crate")
    rug(placer, (1.2, 0.8))
    for _ in range(2):
        hang(placer, "picture", (1.2, 1.5))
    hang(placer, "mirror", (1.0, 1.2))
    hang(placer, "clock", (1.6, 1.9))
    finish(placer)


def hallway(placer: RoomPlacer) -> None:
    """Coats, shoes, a bench."""
    bench = against(placer, "bench")
    put_on(placer, bench, ("hat", "purse", "backpack", "bag", "clothes"), 2)
    put_under(placer, bench, ("shoe", "shoe", "basket", "ball"), 2)
    cabinet = against(placer, "cabinet")
    put_in(placer, cabinet, ("shoe", "box", "hat", "bag", "ball"), 3)
    put_on(placer, cabinet, ("telephone", "table_lamp", "purse", "plant"), 2)
    stand(placer, "coat_rack", "suitcase", "basket", "shoe", "fire_extinguisher", "stool")
    if chance(placer, 0.5):
        against(placer, "bicycle", gap=0.05)
    rug(placer, (0.9, 0.6))
    hang(placer, "mirror", (0.9, 1.1))
    hang(placer, "picture", (1.3, 1.5))
    hang(placer, "calendar", (1.3, 1.5))
    put_on(placer, hang(placer, "shelf", (1.2, 1.5)), ("hat", "box", "basket", "bag"), 2)
    finish(placer)
