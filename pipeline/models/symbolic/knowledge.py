"""What the observer knows of things before it looks: what holds what, what opens or shines, where things belong."""

from __future__ import annotations

from pipeline.models.symbolic.words import listed_in

STRUCTURE = frozenset(listed_in("wall, floor, ceiling, doorframe, column, pillar, windowsill, ledge, structure"))
"""Parts of the building: they hold and frame things, and no question means them unless it names them."""

GROUND = frozenset(listed_in("floor, mat, rug, carpet, shower floor"))
"""What stands on these is on the floor, which says little about where it is."""

BUILDING = STRUCTURE | GROUND

UPRIGHT = frozenset(listed_in("wall, closet wall, shower wall, door, window, divider, column, pillar"))
"""Things hang on these."""

FLOOR_STANDING = frozenset(
    listed_in(
        "armchair, bathroom cabinet, bathroom counter, bathtub, bed, bench, bicycle, bookshelf, cabinet, "
        "chair, clothes dryer, coat rack, coffee table, couch, counter, desk, dining table, dishwasher, door, "
        "dresser, end table, file cabinet, fireplace, folded chair, kitchen counter, ladder, nightstand, "
        "office chair, ottoman, piano, refrigerator, sofa chair, stairs, stool, stove, table, toilet, tv "
        "stand, wardrobe, washing machine"
    )
)
"""Things that stand on the floor: nobody takes one seen over a chair for standing on it."""

CONTAINERS = frozenset(
    listed_in(
        "bag, basket, bathtub, bin, bookshelf, bowl, box, bucket, cabinet, cart, closet, container, crate, cup, "
        "dishwasher, drawer, dresser, fireplace, microwave, oven, purse, rack, refrigerator, shelf, shower, sink, "
        "suitcase, toilet, vase, wardrobe, bathroom cabinet, coat rack, dish rack, file cabinet, kitchen cabinet, "
        "laundry basket, laundry hamper, mini fridge, paper bag, recycling bin, storage bin, storage container, "
        "storage organizer, toaster oven, trash bin, trash can, washing machine"
    )
)
"""Things that others are in rather than on, where they are enclosed."""

SCREENS = frozenset(listed_in("tv, monitor, laptop, projector screen, computer"))
LIGHTS = frozenset(listed_in("lamp, light, ceiling light, floor lamp, table lamp, candle"))
DOORS = frozenset(listed_in("door, closet door, bathroom stall door, shower door"))
CASES = frozenset(
    listed_in(
        "cabinet, kitchen cabinet, bathroom cabinet, file cabinet, wardrobe, closet, refrigerator, mini fridge, oven, "
        "microwave, dishwasher, washing machine, dresser, drawer"
    )
)
"""Things with a front that opens."""
VESSELS = frozenset(
    listed_in(
        "box, suitcase, chest, trash can, trash bin, bin, recycling bin, basket, laundry basket, laundry hamper, "
        "crate, bucket, storage bin, storage container, paper bag"
    )
)
"""Things that open at the top."""
OPENING = DOORS | CASES | VESSELS
CURTAINS = frozenset(listed_in("curtain, blinds, shower curtain"))

ROOM_SIGNS: dict[str, frozenset[str]] = {
    room: frozenset(listed_in(signs))
    for room, signs in {
        "bedroom": "bed, nightstand, dresser, mattress",
        "kitchen": "stove, oven, refrigerator, kitchen cabinet, kitchen counter, dishwasher, range hood, microwave, "
        "toaster, toaster oven, coffee maker, dish rack",
        "bathroom": "toilet, bathtub, shower, shower curtain, bathroom cabinet, bathroom vanity, bathroom counter, "
        "toilet paper, plunger",
        "living room": "couch, coffee table, tv stand, fireplace, sofa chair, ottoman, tv",
        "office": "office chair, computer tower, monitor, printer, file cabinet, whiteboard, desk, copier, keyboard",
        "dining room": "dining table",
        "laundry room": "washing machine, clothes dryer, laundry hamper, ironing board",
    }.items()
}
"""Things that tell what a room is."""
WEAK_SIGNS = frozenset(listed_in("dining table, desk, tv, keyboard, dresser"))
"""Signs that stand in other rooms as well."""

ROOM_NAMES: dict[str, str] = {
    word: room
    for room, words in {
        "bedroom": "bedroom",
        "kitchen": "kitchen",
        "bathroom": "bathroom, restroom, washroom, toilet room",
        "living room": "living room, lounge, sitting room",
        "office": "office, study, study room, workroom",
        "dining room": "dining room",
        "laundry room": "laundry room, laundry, utility room",
        "hallway": "hallway, hall, corridor, entrance",
    }.items()
    for word in listed_in(words)
}
"""Words for rooms."""

MATERIALS: dict[str, str] = {
    name: material
    for material, names in {
        "wood": "table, coffee table, dining table, end table, desk, bookshelf, cabinet, dresser, nightstand, "
        "wardrobe, door",
        "fabric": "couch, armchair, sofa chair, pillow, cushion, curtain, blanket, towel",
        "glass": "mirror, window, bottle",
        "ceramic": "sink, toilet, bathtub, cup, bowl, plate",
        "metal": "refrigerator, stove, oven, radiator",
        "paper": "book",
        "cardboard": "box",
        "plastic": "trash can, bin",
    }.items()
    for name in listed_in(names)
}
"""What a thing is usually made of: a guess, and hedged as one."""
