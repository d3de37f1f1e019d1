"""Kitchen, bathroom and laundry room."""

from __future__ import annotations

from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.rooms.common import (
    CABINET_THINGS,
    UNDER_TABLE,
    against,
    chance,
    finish,
    hang,
    make,
    put_in,
    put_on,
    put_under,
    rug,
    stand,
)

COUNTER_THINGS = (
    "toaster",
    "coffee_maker",
    "microwave",
    "dish_rack",
    "bottle",
    "bowl",
    "cup",
    "paper_towel_roll",
    "plant",
    "coffee_kettle",
    "tray",
    "basket",
    "box",
)


def kitchen(placer: RoomPlacer) -> None:
    """A row of units along one wall, cabinets above, a table with chairs."""
    rng = placer.rng
    # What a kitchen cannot do without comes first: a short wall leaves out the end of the row.
    needed, further = ["sink_unit", "stove", "kitchen_counter"], ["kitchen_cabinet", "dishwasher", "kitchen_counter"]
    rng.shuffle(needed)
    rng.shuffle(further)
    row = placer.run([make(placer, name) for name in ("refrigerator", *needed, *further)])
    placed = {unit.model.category for unit in row}
    for name, category in (("refrigerator", "refrigerator"), ("stove", "stove"), ("sink_unit", "sink")):
        if category not in placed and (unit := against(placer, name, corner=True)):
            row.append(unit)
    for unit in row:
        category = unit.model.category
        if category == "stove":
            hang(placer, "range_hood", (1.5, 1.55), above=unit)
            put_on(placer, unit, ("coffee_kettle", "bowl"), 1, "pot")
        elif category in ("kitchen counter", "kitchen cabinet", "dishwasher"):
            put_on(placer, unit, COUNTER_THINGS, 3)
            if chance(placer, 0.75):
                hang(placer, "wall_cabinet", (1.42, 1.46), above=unit)
        if category in ("kitchen cabinet", "refrigerator"):
            put_in(placer, unit, ("bottle", "bowl", "water_pitcher", "box", "cup", "plate"), 4)
        if category == "sink":
            put_in(placer, unit, ("cup", "bowl", "plate"), 1)
    for thing in list(placer.home.by_room[placer.number]):
        if thing.model.category == "kitchen cabinet" and thing.at[2] > 1.0:
            put_in(placer, thing, CABINET_THINGS[:5], 3)
    table = placer.anywhere(make(placer, "dining_table"), edge=False) or against(placer, "table")
    if table:
        placer.around(table, lambda: make(placer, "chair"), int(rng.integers(2, 5)))
    put_on(placer, table, ("plate", "bowl", "cup", "bottle", "water_pitcher", "candle", "book", "basket"), 4)
    put_under(placer, table, UNDER_TABLE, 2)
    stand(placer, "trash_can", "stool", "paper_bag", "crate", "broom", "fire_extinguisher")
    hang(placer, "clock", (1.6, 1.9))
    hang(placer, "calendar", (1.3, 1.5))
    put_on(placer, hang(placer, "shelf", (1.25, 1.4)), ("bowl", "cup", "bottle", "plant", "water_pitcher"), 3)
    rug(placer, (0.9, 0.6))
    finish(placer)


def bathroom(placer: RoomPlacer) -> None:
    """Tub, toilet, basin and cabinets."""
    vanity = against(placer, "bathroom_counter")
    put_on(placer, vanity, ("basin",), 1, "basin")
    put_on(placer, vanity, ("soap_dispenser", "cup", "tissue_box", "plant", "bottle"), 3)
    hang(placer, "mirror", (1.15, 1.2), above=vanity)
    tub = against(placer, "bathtub", corner=True)
    put_in(placer, tub, ("ball", "bottle", "stuffed_animal", "bucket"), 1)
    if tub:
        placer.beside(tub, make(placer, "shower_curtain"), gap=0.02)
    toilet = against(placer, "toilet", gap=0.05, front=0.45)
    put_on(placer, toilet, ("toilet_roll", "candle", "plant"), 1)
    if toilet:
        placer.beside(toilet, make(placer, "trash_can"), gap=0.12)
    for _ in range(2):
        cabinet = against(placer, "bathroom_cabinet")
        put_in(placer, cabinet, ("toilet_roll", "bottle", "clothes", "soap_dispenser", "cup"), 3)
        put_on(placer, cabinet, ("basket", "candle", "toilet_roll", "plant"), 2)
    for _ in range(2):
        hang(placer, "towel", (0.75, 0.95))
    hang(placer, "toilet_paper", (0.65, 0.75))
    stand(placer, "laundry_basket", "scale", "stool", "bucket")
    rug(placer, (0.75, 0.5), near=tub, distance=0.1)
    finish(placer)


def laundry_room(placer: RoomPlacer) -> None:
    """Machines, baskets, cleaning gear."""
    washer = against(placer, "washing_machine")
    put_on(placer, washer, ("laundry_detergent", "clothes", "basket", "box"), 2)
    if washer:
        dryer = placer.beside(washer, make(placer, "clothes_dryer"), gap=0.04)
        put_on(placer, dryer, ("laundry_detergent", "clothes", "basket"), 1)
    put_on(placer, placer.anywhere(make(placer, "ironing_board")), ("clothes", "bottle"), 1)
    cabinet = against(placer, "cabinet")
    put_in(placer, cabinet, ("bottle", "laundry_detergent", "box", "clothes", "toilet_roll"), 3)
    put_on(placer, cabinet, ("laundry_detergent", "basket", "box"), 1)
    stand(
        placer, "laundry_basket", "laundry_basket", "bucket", "broom", "vacuum_cleaner", "ladder", "tool_box", "crate"
    )
    shelf = hang(placer, "shelf", (1.2, 1.4))
    put_on(placer, shelf, ("laundry_detergent", "box", "toilet_roll", "bottle"), 3)
    rug(placer, (0.8, 0.5))
    finish(placer)
