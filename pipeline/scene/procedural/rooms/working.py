"""Office."""

from __future__ import annotations

from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.rooms.common import (
    CABINET_THINGS,
    SHELF_THINGS,
    against,
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

DESK_THINGS = ("cup", "book", "table_lamp", "telephone", "paper", "headphones", "plant", "tissue_box", "water_bottle")


def office(placer: RoomPlacer) -> None:
    """Desks with screens, shelves, cabinets."""
    rng = placer.rng
    for number in range(2):
        desk = against(placer, "desk", front=0.75)
        put_on(placer, desk, ("monitor",) if number == 0 else ("laptop", "monitor"), 1, turn=0.15)
        put_on(placer, desk, ("keyboard",), 1)
        put_on(placer, desk, ("mouse", "mouse", "laptop"), 1)
        put_on(placer, desk, DESK_THINGS, int(rng.integers(2, 4)))
        put_under(placer, desk, ("computer_tower", "trash_can", "backpack", "box", "shoe"), 2)
        if desk:
            seat = placer.in_front(desk, make(placer, "office_chair"), gap=0.08, facing=True)
            put_on(placer, seat, ("cushion", "bag", "book"), int(rng.random() < 0.3), "seat")
    put_in(placer, against(placer, "bookshelf"), SHELF_THINGS, 8)
    for _ in range(2):
        files = against(placer, "file_cabinet")
        put_on(placer, files, ("printer", "plant", "box", "paper", "basket"), 1)
    cabinet = against(placer, "cabinet")
    put_in(placer, cabinet, (*CABINET_THINGS, "paper", "telephone"), 3)
    put_on(placer, cabinet, ("printer", "box", "plant"), 1)
    seat = against(placer, "armchair", gap=0.45)
    put_behind(placer, seat)
    stand(placer, "trash_can", "backpack", "potted_plant", "floor_lamp", "box", "suitcase")
    rug(placer, (1.2, 0.8))
    hang(placer, "whiteboard", (0.95, 1.1))
    hang(placer, "bulletin_board", (1.1, 1.3))
    hang(placer, "picture", (1.2, 1.5))
    put_on(placer, hang(placer, "shelf", (1.2, 1.4)), SHELF_THINGS, 3)
    hang(placer, "clock", (1.6, 1.9))
    finish(placer)
