"""Kitchen and laundry appliances and counters."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.storage import BOARD_M, cupboard
from pipeline.scene.procedural.paint import Paint, Texture, flat, lit, metal, mix, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot

COUNTER_M = 0.9
"""Height of counters and of the appliances that stand in line with them."""


def stone(color: str, rng: np.random.Generator) -> Paint:
    """Return a speckled counter top."""
    return Paint(mix(color, rng), Texture.FABRIC, 0.12, 0.10, 0.08)


def kitchen_counter(rng: np.random.Generator) -> Model:
    """Base unit with a stone top and doors."""
    color = pick(rng, "white", "brown", "gray", "blue", "green")
    w, d, s = float(rng.choice([0.9, 1.2])), 0.6, Shape()
    front, knob = wood(color, rng) if color == "brown" else flat(color, rng), metal("black", rng)
    s.block((0, -0.02, 0.08), (w, d - 0.04, COUNTER_M - 0.12), front)
    s.block((0, -0.05, 0), (w, d - 0.12, 0.08), flat("black", rng), skip=("top", "bottom"))
    s.board((0, 0, COUNTER_M - 0.04), (w, d, 0.04), stone(pick(rng, "gray", "white", "black"), rng))
    for k in range(2):
        x = (k - 0.5) * w / 2
        s.board((x, d / 2 - 0.035, 0.10), (w / 2 - 0.02, 0.02, 0.72), front)
        s.board((x, d / 2 - 0.015, 0.72), (0.16, 0.02, 0.02), knob)
    on = Slot("on", (-w / 2 + 0.04, -d / 2 + 0.03, COUNTER_M), (w / 2 - 0.04, d / 2 - 0.05, COUNTER_M + 0.42))
    return Model("kitchen counter", color, s, slots=(on,))


def kitchen_cabinet(rng: np.random.Generator) -> Model:
    """Base cabinet, open or closed, in line with the counters."""
    color = pick(rng, "white", "brown", "gray", "red", "green")
    return cupboard(
        "kitchen cabinet",
        rng,
        (0.8, 0.58, COUNTER_M),
        color=color,
        is_open=rng.random() < 0.6,
        shelves=1,
        top_slot=True,
        base_m=0.08,
    )


def sink_unit(rng: np.random.Generator) -> Model:
    """Kitchen sink in its own unit: a basin one looks into from above."""
    s, w, d, h = Shape(), 0.8, 0.6, COUNTER_M
    steel, front = metal("gray", rng), flat(pick(rng, "white", "gray"), rng)
    s.block((0, -0.02, 0), (w, d - 0.04, h - 0.22), front, skip=("bottom",))
    s.hollow((0, 0, h - 0.22), (w, d, 0.22), 0.05, steel)
    s.tube((0, -d / 2 + 0.03, h), 0.018, 0.26, steel)
    s.rod((0, -d / 2 + 0.03, h + 0.25), (0, 0.2, -0.02), 0.014, steel)
    basin = Slot("in", (-w / 2 + 0.09, -d / 2 + 0.09, h - 0.17), (w / 2 - 0.09, d / 2 - 0.08, h - 0.02))
    return Model("sink", "gray", s, slots=(basin,))


def stove(rng: np.random.Generator) -> Model:
    """Cooker with four plates and an oven door."""
    color = pick(rng, "white", "black", "gray")
    body, dark, s = metal(color, rng), metal("gray" if color == "black" else "black", rng), Shape()
    s.block((0, -0.015, 0), (0.6, 0.57, COUNTER_M - 0.01), body, skip=("bottom",))
    for x in (-0.14, 0.14):
        for y in (-0.13, 0.13):
            s.tube((x, y, COUNTER_M - 0.01), 0.08, 0.012, dark, caps="top")
    s.board((0, 0.28, 0.22), (0.42, 0.02, 0.3), metal("black", rng))
    s.board((0, 0.285, 0.68), (0.46, 0.03, 0.025), metal("gray", rng))
    for k in range(4):
        s.rod((-0.2 + 0.13 * k, 0.27, 0.80), (0, 0.03, 0), 0.02, dark)
    return Model("stove", color, s, slots=(Slot("on", (-0.24, -0.22, 0.902), (0.24, 0.22, 1.25), "pot"),))


def range_hood(rng: np.random.Generator) -> Model:
    """Hood on the wall over a stove."""
    color, s = pick(rng, "gray", "white", "black"), Shape()
    paint = metal(color, rng)
    s.block((0, 0, 0), (0.6, 0.45, 0.14), paint)
    s.block((0, -0.07, 0.14), (0.28, 0.28, 0.46), paint, skip=("bottom",))
    return Model("range hood", color, s)


def refrigerator(rng: np.random.Generator) -> Model:
    """Tall refrigerator; an open one shows its shelves."""
    color = pick(rng, "white", "gray", "black", "red")
    body, knob, s = metal(color, rng), metal("gray" if color != "gray" else "black", rng), Shape()
    w, d, h, split, t = 0.62, 0.62, 1.75, 0.6, 0.05
    s.block((0, -0.02, 0), (w, d - 0.08, split), body)
    s.board((0, d / 2 - 0.03, 0.03), (w - 0.01, 0.06, split - 0.04), body)
    s.board((-0.22, d / 2 + 0.01, 0.3), (0.025, 0.02, 0.2), knob)
    if rng.random() < 0.65:
        s.block((0, -0.02, split), (w, d - 0.08, h - split), body)
        s.board((0, d / 2 - 0.03, split + 0.01), (w - 0.01, 0.06, h - split - 0.02), body)
        s.board((-0.22, d / 2 + 0.01, 0.9), (0.025, 0.02, 0.3), knob)
        return Model("refrigerator", color, s, ("closed",))
    s.hollow((0, -0.04, split), (w, d - 0.08, h - split), t, body, open_side="front")
    inner, slots = flat("white", rng), []
    for k in range(3):
        z = split + t + k * 0.34
        if k:
            s.board((0, -0.05, z - BOARD_M), (w - 2 * t, d - 0.24, BOARD_M), inner)
        slots.append(Slot("in", (-w / 2 + 0.07, -d / 2 + 0.08, z), (w / 2 - 0.07, d / 2 - 0.16, z + 0.29)))
    door = Shape()
    door.board((-w / 2, 0, 0), (w - 0.01, 0.06, h - split - 0.02), body)
    s.merge(door, at=(w / 2 - 0.03, d / 2 - 0.04, split + 0.01), yaw=-float(rng.uniform(1.6, 1.8)))
    return Model("refrigerator", color, s, ("open",), tuple(slots))


def dishwasher(rng: np.random.Generator) -> Model:
    """Dishwasher front in line with the counters."""
    color, s = pick(rng, "white", "gray", "black"), Shape()
    paint, dark = metal(color, rng), metal("black" if color != "black" else "gray", rng)
    s.block((0, -0.02, 0), (0.6, 0.56, COUNTER_M), paint, skip=("bottom",))
    s.board((0, 0.27, 0.1), (0.57, 0.02, 0.62), paint)
    s.board((0, 0.27, 0.76), (0.57, 0.02, 0.12), dark)
    return Model("dishwasher", color, s, ("closed",), (Slot("on", (-0.26, -0.26, 0.9), (0.26, 0.22, 1.3)),))


def microwave(rng: np.random.Generator) -> Model:
    """Microwave oven with a dark window."""
    color = pick(rng, "white", "gray", "black", "red")
    body, s = metal(color, rng), Shape()
    s.block((0, -0.01, 0), (0.46, 0.32, 0.27), body, skip=("bottom",))
    s.board((-0.06, 0.16, 0.04), (0.28, 0.02, 0.19), metal("gray" if color == "black" else "black", rng))
    s.board((0.16, 0.155, 0.05), (0.08, 0.01, 0.17), flat("gray" if color != "gray" else "white", rng))
    return Model("microwave", color, s, slots=(Slot("on", (-0.18, -0.13, 0.27), (0.18, 0.12, 0.5)),))


def toaster(rng: np.random.Generator) -> Model:
    """Two-slot toaster."""
    color = pick(rng, "red", "gray", "white", "black", "blue")
    s = Shape()
    s.block((0, 0, 0), (0.28, 0.17, 0.18), metal(color, rng), skip=("bottom",), top=(0.94, 0.88))
    for y in (-0.03, 0.03):
        s.board((0, y, 0.18), (0.18, 0.025, 0.004), flat("black", rng))
    return Model("toaster", color, s)


def coffee_maker(rng: np.random.Generator) -> Model:
    """Coffee machine with a glass pot."""
    color, s = pick(rng, "black", "white", "red", "gray"), Shape()
    body = flat(color, rng)
    s.block((0, -0.08, 0), (0.2, 0.1, 0.32), body, skip=("bottom",))
    s.board((0, 0.02, 0), (0.2, 0.24, 0.04), body)
    s.board((0, 0.02, 0.24), (0.2, 0.22, 0.08), body)
    s.tube((0, 0.05, 0.045), 0.065, 0.14, flat("brown", rng), tip=0.8)
    return Model("coffee maker", color, s)


def dish_rack(rng: np.random.Generator) -> Model:
    """Rack of thin bars with an open top."""
    color, s = pick(rng, "gray", "white", "black"), Shape()
    paint = metal(color, rng)
    s.board((0, 0, 0), (0.42, 0.3, 0.015), paint)
    for k in range(9):
        x = -0.2 + 0.05 * k
        for y in (-0.14, 0.14):
            s.tube((x, y, 0.015), 0.006, 0.1, paint, caps="none")
    for y in (-0.14, 0.14):
        s.rod((-0.21, y, 0.115), (0.42, 0, 0), 0.007, paint)
    return Model("dish rack", color, s, slots=(Slot("in", (-0.17, -0.1, 0.015), (0.17, 0.1, 0.4)),))


def washing_machine(rng: np.random.Generator) -> Model:
    """Front loader with a round door."""
    return _drum("washing machine", pick(rng, "white", "white", "gray"), "blue", rng)


def clothes_dryer(rng: np.random.Generator) -> Model:
    """Dryer with a round door."""
    return _drum("clothes dryer", pick(rng, "white", "gray", "black"), "black", rng)


def _drum(category: str, color: str, glass: str, rng: np.random.Generator) -> Model:
    s, h = Shape(), 0.86
    s.block((0, -0.02, 0), (0.6, 0.56, h), metal(color, rng), skip=("bottom",))
    ring = metal("gray" if color != "gray" else "white", rng)
    s.rod((0, 0.26, 0.42), (0, 0.03, 0), 0.2, ring, caps="none")
    s.ring((0, 0.29, 0.42), (0, 1, 0), 0.15, 0.2, ring)
    s.ring((0, 0.285, 0.42), (0, 1, 0), 0.0, 0.15, metal(glass if color != "black" else "gray", rng))
    s.board((0, 0.265, 0.74), (0.54, 0.01, 0.08), ring)
    s.board((0.2, 0.272, 0.76), (0.08, 0.008, 0.04), lit((0.5, 0.95, 0.6)))
    on = Slot("on", (-0.26, -0.26, h), (0.26, 0.22, h + 0.5))
    return Model(category, color, s, ("closed",), (on,))
