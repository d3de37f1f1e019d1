"""Tables and desks: things stand on them and lie under them."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.seating import FURNITURE_COLORS
from pipeline.scene.procedural.paint import flat, metal, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot


def _table(
    category: str, rng: np.random.Generator, size: tuple[float, float, float], *, leg: float, colors: tuple[str, ...]
) -> Model:
    color = pick(rng, *colors)
    paint = wood(color, rng)
    (w, d, h), top, s = size, 0.035, Shape()
    s.legs(w - 0.06, d - 0.06, h - top, leg, paint)
    s.board((0, 0, h - top), (w, d, top), paint)
    s.board((0, d / 2 - 0.08, h - top - 0.06), (w - 0.16, 0.02, 0.06), paint)
    s.board((0, -d / 2 + 0.08, h - top - 0.06), (w - 0.16, 0.02, 0.06), paint)
    on = Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.03, h + 0.7))
    inset = leg + 0.05
    under = Slot("under", (-w / 2 + inset, -d / 2 + inset, 0.0), (w / 2 - inset, d / 2 - inset, h - top - 0.08))
    return Model(category, color, s, slots=(on, under), contact="none")


def coffee_table(rng: np.random.Generator) -> Model:
    """Low table before a couch."""
    size = (float(rng.uniform(0.9, 1.15)), float(rng.uniform(0.5, 0.6)), float(rng.uniform(0.40, 0.46)))
    return _table("coffee table", rng, size, leg=0.05, colors=FURNITURE_COLORS)


def dining_table(rng: np.random.Generator) -> Model:
    """Table to eat at."""
    size = (float(rng.uniform(1.2, 1.6)), float(rng.uniform(0.75, 0.9)), 0.75)
    return _table("dining table", rng, size, leg=0.07, colors=("brown", "brown", "white", "gray"))


def table(rng: np.random.Generator) -> Model:
    """Small work or play table."""
    size = (float(rng.uniform(0.8, 1.1)), float(rng.uniform(0.55, 0.7)), float(rng.uniform(0.62, 0.75)))
    return _table("table", rng, size, leg=0.05, colors=("brown", "white", "red", "green", "blue"))


def end_table(rng: np.random.Generator) -> Model:
    """Small round or square table beside a seat."""
    if rng.random() < 0.5:
        side = float(rng.uniform(0.42, 0.5))
        return _table("end table", rng, (side, side, 0.5), leg=0.04, colors=FURNITURE_COLORS)
    color = pick(rng, *FURNITURE_COLORS)
    paint, s = wood(color, rng), Shape()
    s.tube((0, 0, 0), 0.16, 0.03, paint, caps="top")
    s.tube((0, 0, 0.03), 0.03, 0.47, paint, caps="none")
    s.tube((0, 0, 0.5), 0.24, 0.03, paint)
    return Model("end table", color, s, slots=(Slot("on", (-0.16, -0.16, 0.53), (0.16, 0.16, 1.1)),), contact="none")


def desk(rng: np.random.Generator) -> Model:
    """Desk with a drawer block on one side and an open knee space."""
    color = pick(rng, "brown", "white", "black", "gray")
    paint, s = wood(color, rng), Shape()
    w, d, h, top = float(rng.uniform(1.2, 1.5)), float(rng.uniform(0.62, 0.72)), 0.74, 0.03
    side = 1 if rng.random() < 0.5 else -1
    s.board((0, 0, h - top), (w, d, top), paint)
    s.board((-side * (w / 2 - 0.02), 0, 0), (0.03, d - 0.06, h - top), paint)
    s.board((0, -d / 2 + 0.04, 0.3), (w - 0.08, 0.02, h - top - 0.3), paint)
    block_w = 0.38
    s.block((side * (w / 2 - block_w / 2 - 0.02), 0, 0), (block_w, d - 0.06, h - top), paint, skip=("top", "bottom"))
    knob = metal("gray", rng)
    for k in range(3):
        s.board((side * (w / 2 - block_w / 2 - 0.02), d / 2 - 0.02, 0.12 + 0.22 * k), (0.14, 0.02, 0.02), knob)
    on = Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.03, h + 0.7))
    left, right = sorted((-side * (w / 2 - 0.06), side * (w / 2 - block_w - 0.06)))
    under = Slot("under", (left, -d / 2 + 0.08, 0.0), (right, d / 2 - 0.05, 0.6))
    return Model("desk", color, s, slots=(on, under), contact="none")


def ironing_board(rng: np.random.Generator) -> Model:
    """Board on crossed legs."""
    color = pick(rng, "blue", "green", "pink", "gray")
    steel, s, h = metal("gray", rng), Shape(), 0.85
    s.board((0, 0, h), (1.1, 0.32, 0.035), flat(color, rng))
    for y in (-0.1, 0.1):
        s.rod((-0.4, y, 0.0), (0.8, 0.0, h), 0.014, steel, caps="none")
        s.rod((0.4, y, 0.0), (-0.8, 0.0, h), 0.014, steel, caps="none")
    on = Slot("on", (-0.5, -0.13, h + 0.035), (0.5, 0.13, h + 0.5))
    return Model("ironing board", color, s, slots=(on,), contact="none")
