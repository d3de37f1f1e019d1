"""Beds and what belongs to them."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.seating import FABRIC_COLORS
from pipeline.scene.procedural.paint import cloth, flat, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot


def bed(rng: np.random.Generator) -> Model:
    """Bed on legs with a headboard; its colour is the bedspread's."""
    color = pick(rng, "blue", "white", "gray", "green", "red", "purple", "pink", "yellow")
    w, d, base, top = float(rng.choice([1.0, 1.4, 1.6])), 2.05, 0.30, 0.54
    frame, spread, s = wood(pick(rng, "brown", "white", "black"), rng), cloth(color, rng), Shape()
    s.legs(w, d, base, 0.07, frame)
    s.block((0, 0, base), (w, d, 0.10), frame)
    s.block((0, 0.02, base + 0.10), (w - 0.04, d - 0.08, top - base - 0.10), spread, skip=("bottom",))
    s.board((0, -d / 2 + 0.025, 0.30), (w, 0.05, 0.68), frame)
    head = Slot("on", (-w / 2 + 0.05, -d / 2 + 0.10, top), (w / 2 - 0.05, -d / 2 + 0.52, top + 0.5), "pillow")
    foot = Slot("on", (-w / 2 + 0.02, d / 2 - 0.52, top), (w / 2 - 0.02, d / 2 - 0.06, top + 0.3), "blanket")
    middle = Slot("on", (-w / 2 + 0.06, -d / 2 + 0.56, top), (w / 2 - 0.06, d / 2 - 0.56, top + 0.6))
    under = Slot("under", (-w / 2 + 0.09, -d / 2 + 0.15, 0.0), (w / 2 - 0.09, d / 2 - 0.06, base - 0.015))
    return Model("bed", color, s, slots=(head, foot, middle, under), contact="none")


def pillow(rng: np.random.Generator) -> Model:
    """Bed pillow."""
    color = pick(rng, "white", "white", "gray", "blue", "pink", "yellow")
    s, w, d, h = Shape(), float(rng.uniform(0.44, 0.5)), 0.34, 0.13
    s.ball((0, 0, h / 2), (w / 2, d / 2, h / 2), cloth(color, rng))
    return Model("pillow", color, s)


def cushion(rng: np.random.Generator) -> Model:
    """Square cushion that lies on a seat."""
    color = pick(rng, *FABRIC_COLORS, "white")
    s, side, h = Shape(), float(rng.uniform(0.34, 0.42)), 0.15
    paint = cloth(color, rng)
    s.block((0, 0, 0), (side * 0.86, side * 0.86, h / 2), paint, skip=("bottom", "top"), top=(1.16, 1.16))
    s.block((0, 0, h / 2), (side, side, h / 2), paint, skip=("bottom",), top=(0.7, 0.7))
    return Model("cushion", color, s)


def blanket(rng: np.random.Generator) -> Model:
    """Folded blanket."""
    color = pick(rng, *FABRIC_COLORS, "white")
    s, w, d = Shape(), float(rng.uniform(0.6, 0.85)), 0.42
    s.block((0, 0, 0), (w, d, 0.05), cloth(color, rng), skip=("bottom",), top=(0.97, 0.95))
    s.block((0, 0.0, 0.05), (w * 0.95, d * 0.9, 0.035), cloth(color, rng), skip=("bottom",), top=(0.96, 0.93))
    return Model("blanket", color, s)


def clothes(rng: np.random.Generator) -> Model:
    """Pile of folded clothes; its colour is the topmost piece's."""
    color, s, z = pick(rng, *FABRIC_COLORS, "white"), Shape(), 0.0
    for k in range(3):
        paint = cloth(color if k == 2 else pick(rng, "gray", "blue", "white", "black", "brown"), rng)
        h = 0.05 if k < 2 else 0.09
        s.block((0, 0, z), (0.36 - 0.01 * k, 0.28, h), paint, skip=("bottom",), top=(0.96, 0.94))
        z += h
    return Model("clothes", color, s)


def stuffed_animal(rng: np.random.Generator) -> Model:
    """Sitting bear."""
    color = pick(rng, "brown", "pink", "white", "gray", "blue", "yellow")
    fur, dark, s, r = cloth(color, rng), flat("black", rng), Shape(), float(rng.uniform(0.09, 0.12))
    s.ball((0, 0, r), (r, r * 0.9, r), fur)
    s.ball((0, 0.01, 2.45 * r), r * 0.72, fur)
    for side in (-1, 1):
        s.ball((side * 0.55 * r, 0, 3.05 * r), r * 0.26, fur)
        s.ball((side * 0.75 * r, 0.8 * r, 0.36 * r), (r * 0.34, r * 0.5, r * 0.34), fur)
        s.ball((side * 1.0 * r, 0.3 * r, 1.35 * r), (r * 0.28, r * 0.28, r * 0.5), fur)
        s.ball((side * 0.28 * r, 0.62 * r, 2.65 * r), r * 0.1, dark)
    return Model("stuffed animal", color, s)
