"""Furniture that holds things: cabinets with doors, shelves, dressers, stands."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.seating import FURNITURE_COLORS
from pipeline.scene.procedural.paint import Paint, flat, metal, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot

BOARD_M = 0.022
"""Thickness of carcass boards."""


def cupboard(
    category: str,
    rng: np.random.Generator,
    size: tuple[float, float, float],
    *,
    color: str,
    is_open: bool,
    shelves: int,
    top_slot: bool,
    base_m: float = 0.0,
) -> Model:
    """Return a carcass with two doors, closed, or swung open so that its shelves show.

    Args:
        category: ScanNet200 name.
        rng: Source of small variations.
        size: Outer width, depth (doors shut) and height, metres.
        color: Basic colour name.
        is_open: Whether the doors stand open.
        shelves: Boards between bottom and top.
        top_slot: Whether things may stand on top.
        base_m: Height of a plinth beneath, metres.
    """
    (w, d, h), t, s = size, BOARD_M, Shape()
    paint = wood(color, rng) if color == "brown" else flat(color, rng)
    knob = metal("gray" if color != "gray" else "black", rng)
    slots = [Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.05, h + 0.6))] if top_slot else []
    if base_m:
        s.block((0, -0.02, 0), (w - 0.04, d - 0.08, base_m), paint, skip=("top", "bottom"))
    if not is_open:
        s.block((0, -t / 2, base_m), (w, d - t, h - base_m), paint)
        for side in (-1, 1):
            s.board((side * w / 4, d / 2 - t, base_m + 0.015), (w / 2 - 0.012, t, h - base_m - 0.03), paint)
            s.board((side * 0.05, d / 2, base_m + (h - base_m) * 0.5), (0.02, 0.02, min(0.14, 0.3 * h)), knob)
        return Model(category, color, s, ("closed",), tuple(slots))
    s.hollow((0, -t / 2, base_m), (w, d - t, h - base_m), t, paint, open_side="front")
    rise = (h - base_m - 2 * t) / (shelves + 1)
    for k in range(shelves + 1):
        z = base_m + t + k * rise
        if k:
            s.board((0, -t, z - t), (w - 2 * t, d - 3 * t, t), paint)
        slots.append(Slot("in", (-w / 2 + 0.05, -d / 2 + 0.05, z), (w / 2 - 0.05, d / 2 - 0.04, z + rise - t - 0.02)))
    for side in (-1, 1):
        door = Shape()
        door.board((-side * (w / 4), 0, 0), (w / 2 - 0.012, t, h - base_m - 0.03), paint)
        door.board((-side * (w / 2 - 0.05), t / 2 + 0.01, (h - base_m) * 0.5), (0.02, 0.02, min(0.14, 0.3 * h)), knob)
        # Doors open by about 100 degrees, hinged at the outer front edges.
        s.merge(
            door, at=(side * (w / 2 - t / 2), d / 2 - t / 2, base_m + 0.015), yaw=-side * float(rng.uniform(1.6, 1.85))
        )
    return Model(category, color, s, ("open",), tuple(slots))


def cabinet(rng: np.random.Generator) -> Model:
    """Low cabinet with two doors, open or closed."""
    size = (float(rng.uniform(0.8, 1.1)), 0.42, float(rng.uniform(0.8, 1.15)))
    color = pick(rng, "brown", "white", "gray", "blue", "green", "red")
    return cupboard(
        "cabinet", rng, size, color=color, is_open=rng.random() < 0.5, shelves=1, top_slot=True, base_m=0.06
    )


def wardrobe(rng: np.random.Generator) -> Model:
    """Tall cabinet for clothes, open or closed."""
    size = (float(rng.uniform(1.0, 1.3)), 0.58, float(rng.uniform(1.9, 2.05)))
    color = pick(rng, "brown", "white", "gray", "black")
    return cupboard(
        "wardrobe", rng, size, color=color, is_open=rng.random() < 0.5, shelves=2, top_slot=False, base_m=0.06
    )


def wall_cabinet(rng: np.random.Generator) -> Model:
    """Kitchen cabinet that hangs on the wall."""
    size = (float(rng.uniform(0.6, 0.9)), 0.33, 0.6)
    color = pick(rng, "white", "brown", "gray", "blue")
    return cupboard("kitchen cabinet", rng, size, color=color, is_open=rng.random() < 0.45, shelves=1, top_slot=False)


def bathroom_cabinet(rng: np.random.Generator) -> Model:
    """Narrow cabinet on the bathroom floor."""
    size = (float(rng.uniform(0.42, 0.55)), 0.33, float(rng.uniform(0.8, 1.3)))
    color = pick(rng, "white", "brown", "gray", "green")
    is_open = rng.random() < 0.5
    return cupboard("bathroom cabinet", rng, size, color=color, is_open=is_open, shelves=2, top_slot=True, base_m=0.05)


def _drawers(
    s: Shape, width: float, depth: float, low: float, high: float, count: int, paint: Paint, knob: Paint
) -> None:
    rise = (high - low) / count
    for k in range(count):
        s.board((0, depth / 2 - 0.01, low + k * rise + 0.01), (width - 0.04, 0.02, rise - 0.02), paint)
        s.board((0, depth / 2 + 0.01, low + (k + 0.5) * rise - 0.01), (0.16, 0.02, 0.02), knob)


def dresser(rng: np.random.Generator) -> Model:
    """Chest of drawers."""
    color = pick(rng, *FURNITURE_COLORS, "green", "blue")
    paint, s = wood(color, rng), Shape()
    w, d, h = float(rng.uniform(0.9, 1.2)), 0.46, float(rng.uniform(0.8, 1.0))
    s.block((0, -0.01, 0), (w, d - 0.02, h), paint, skip=("bottom",))
    _drawers(
        s, w, d, 0.06, h - 0.02, int(rng.integers(3, 5)), paint, metal("gray" if color != "gray" else "black", rng)
    )
    on = Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.05, h + 0.6))
    return Model("dresser", color, s, slots=(on,))


def nightstand(rng: np.random.Generator) -> Model:
    """Bedside table with a drawer and an open shelf."""
    color = pick(rng, "brown", "white", "black", "gray")
    paint, s = wood(color, rng), Shape()
    w, d, h = float(rng.uniform(0.42, 0.5)), 0.40, float(rng.uniform(0.5, 0.58))
    s.hollow((0, -0.01, 0.06), (w, d - 0.02, h - 0.24), BOARD_M, paint, open_side="front")
    s.block((0, -0.01, h - 0.18), (w, d - 0.02, 0.18), paint)
    s.legs(w - 0.02, d - 0.04, 0.06, 0.04, paint)
    _drawers(s, w, d, h - 0.17, h - 0.01, 1, paint, metal("gray" if color != "gray" else "black", rng))
    on = Slot("on", (-w / 2 + 0.02, -d / 2 + 0.02, h), (w / 2 - 0.02, d / 2 - 0.04, h + 0.6))
    inside = Slot("in", (-w / 2 + 0.04, -d / 2 + 0.04, 0.06 + BOARD_M), (w / 2 - 0.04, d / 2 - 0.05, h - 0.24))
    return Model("nightstand", color, s, slots=(on, inside))


def file_cabinet(rng: np.random.Generator) -> Model:
    """Steel cabinet with drawers."""
    color = pick(rng, "gray", "black", "white", "green")
    paint, s = flat(color, rng), Shape()
    w, d, h = 0.42, 0.5, float(rng.choice([0.68, 1.0, 1.3]))
    s.block((0, -0.01, 0), (w, d - 0.02, h), paint, skip=("bottom",))
    _drawers(
        s, w, d, 0.04, h - 0.02, max(2, round(h / 0.33)), paint, metal("black" if color != "black" else "gray", rng)
    )
    on = Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.05, h + 0.5))
    return Model("file cabinet", color, s, slots=(on,))


def bookshelf(rng: np.random.Generator) -> Model:
    """Tall case of open shelves with a back."""
    color = pick(rng, *FURNITURE_COLORS)
    paint, s, t = wood(color, rng), Shape(), BOARD_M
    w, d, h = float(rng.uniform(0.7, 1.0)), 0.3, float(rng.uniform(1.5, 2.0))
    levels = int(rng.integers(4, 6))
    s.hollow((0, 0, 0), (w, d, h), t, paint, open_side="front")
    rise, slots = (h - 2 * t) / levels, []
    for k in range(levels):
        z = t + k * rise
        if k:
            s.board((0, t / 2, z - t), (w - 2 * t, d - t, t), paint)
        slots.append(Slot("in", (-w / 2 + 0.03, -d / 2 + 0.04, z), (w / 2 - 0.03, d / 2 - 0.02, z + rise - t - 0.01)))
    return Model("bookshelf", color, s, slots=tuple(slots))


def shelf(rng: np.random.Generator) -> Model:
    """Board on the wall with two brackets."""
    color = pick(rng, "brown", "white", "black", "red")
    paint, s = wood(color, rng), Shape()
    w, d = float(rng.uniform(0.7, 1.1)), 0.24
    s.board((0, 0, 0.14), (w, d, 0.025), paint)
    for side in (-1, 1):
        s.block((side * (w / 2 - 0.1), -0.03, 0), (0.025, d - 0.06, 0.14), paint, skip=("top",), top=(1.0, 1.0))
    on = Slot("on", (-w / 2 + 0.02, -d / 2 + 0.02, 0.165), (w / 2 - 0.02, d / 2 - 0.01, 0.55))
    return Model("shelf", color, s, slots=(on,))


def tv_stand(rng: np.random.Generator) -> Model:
    """Low, wide stand with two open bays."""
    color = pick(rng, "brown", "white", "black", "gray")
    paint, s, t = wood(color, rng), Shape(), BOARD_M
    w, d, h = float(rng.uniform(1.2, 1.5)), 0.4, float(rng.uniform(0.42, 0.52))
    s.hollow((0, 0, 0.06), (w, d, h - 0.06), t, paint, open_side="front")
    s.board((0, t / 2, 0.06 + t), (t, d - t, h - 0.06 - 2 * t), paint)
    s.legs(w - 0.04, d - 0.04, 0.06, 0.05, paint)
    slots = [Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.03, h + 0.9))]
    for low, high in ((-w / 2 + 0.04, -0.03), (0.03, w / 2 - 0.04)):
        slots.append(Slot("in", (low, -d / 2 + 0.04, 0.06 + t), (high, d / 2 - 0.03, h - t - 0.02)))
    return Model("tv stand", color, s, slots=tuple(slots))
