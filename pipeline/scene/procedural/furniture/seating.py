"""Things to sit on."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.paint import cloth, flat, metal, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot

FURNITURE_COLORS = ("brown", "brown", "white", "black", "gray")
FABRIC_COLORS = ("gray", "blue", "red", "green", "brown", "purple", "orange", "yellow", "black", "pink")


def couch(rng: np.random.Generator) -> Model:
    """Couch of two or three seats; room under it is too low for anything."""
    color = pick(rng, "gray", "blue", "green", "red", "brown", "purple")
    seats = int(rng.integers(2, 4))
    w, d, arm = 0.75 * seats + 0.36, 0.9, 0.18
    body, s = cloth(color, rng), Shape()
    s.block((0, 0, 0.06), (w, d, 0.28), body)
    s.block((0, -d / 2 + 0.11, 0.34), (w - 2 * arm, 0.22, 0.48), body, skip=("bottom",))
    for side in (-1, 1):
        s.block((side * (w - arm) / 2, 0, 0.34), (arm, d, 0.26), body, skip=("bottom",))
    for i in range(seats):
        x = (i - (seats - 1) / 2) * (w - 2 * arm) / seats
        s.block((x, 0.10, 0.34), ((w - 2 * arm) / seats - 0.02, 0.66, 0.10), body, skip=("bottom",))
    s.legs(w - 0.1, d - 0.1, 0.06, 0.05, wood("brown", rng))
    seat = Slot("on", (-w / 2 + arm + 0.02, -0.20, 0.44), (w / 2 - arm - 0.02, 0.40, 1.0), "seat")
    behind = Slot("behind", (-w / 2 - 0.12, -d / 2 - 0.46, 0.0), (w / 2 + 0.12, -d / 2 - 0.03, 1.6))
    return Model("couch", color, s, slots=(seat, behind), contact="none")


def armchair(rng: np.random.Generator) -> Model:
    """Upholstered chair for one."""
    color = pick(rng, *FABRIC_COLORS)
    body, s = cloth(color, rng), Shape()
    w, d = float(rng.uniform(0.78, 0.9)), 0.82
    s.block((0, 0, 0.08), (w, d, 0.30), body)
    s.block((0, -d / 2 + 0.1, 0.38), (w, 0.2, 0.5), body, skip=("bottom",))
    for side in (-1, 1):
        s.block((side * (w / 2 - 0.08), 0.1, 0.38), (0.16, d - 0.2, 0.22), body, skip=("bottom", "back"))
    s.block((0, 0.12, 0.38), (w - 0.34, 0.54, 0.07), body, skip=("bottom",))
    s.legs(w - 0.1, d - 0.1, 0.08, 0.05, wood("brown", rng))
    seat = Slot("on", (-w / 2 + 0.18, -0.12, 0.45), (w / 2 - 0.18, 0.36, 0.9), "seat")
    behind = Slot("behind", (-w / 2 - 0.16, -d / 2 - 0.42, 0.0), (w / 2 + 0.16, -d / 2 - 0.03, 1.5))
    return Model("armchair", color, s, slots=(seat, behind), contact="none")


def chair(rng: np.random.Generator) -> Model:
    """Four legs, a seat and a back."""
    color = pick(rng, "brown", "brown", "white", "black", "red", "blue", "green", "yellow", "orange")
    paint = wood(color, rng) if color == "brown" else flat(color, rng)
    w, d, s = float(rng.uniform(0.40, 0.46)), 0.44, Shape()
    s.legs(w, d, 0.43, 0.045, paint)
    s.board((0, 0, 0.43), (w, d, 0.04), paint)
    top = float(rng.uniform(0.86, 0.98))
    for side in (-1, 1):
        s.block((side * (w / 2 - 0.025), -d / 2 + 0.02, 0.47), (0.05, 0.04, top - 0.47), paint, skip=("bottom",))
    s.board((0, -d / 2 + 0.02, top - 0.28), (w - 0.1, 0.03, 0.26), paint)
    seat = Slot("on", (-w / 2 + 0.03, -d / 2 + 0.06, 0.47), (w / 2 - 0.03, d / 2 - 0.03, 0.9), "seat")
    return Model("chair", color, s, slots=(seat,), contact="none")


def office_chair(rng: np.random.Generator) -> Model:
    """Swivel chair on a star of five feet."""
    color = pick(rng, "black", "gray", "blue", "red", "green")
    body, steel, s = cloth(color, rng), metal("black", rng), Shape()
    for k in range(5):
        angle = 2 * np.pi * k / 5 + 0.3
        s.rod((0, 0, 0.08), (0.27 * np.cos(angle), 0.27 * np.sin(angle), -0.04), 0.022, steel)
        s.ball((0.27 * np.cos(angle), 0.27 * np.sin(angle), 0.03), 0.03, steel)
    s.tube((0, 0, 0.08), 0.03, 0.36, steel)
    s.board((0, 0, 0.44), (0.48, 0.46, 0.08), body)
    s.board((0, -0.22, 0.60), (0.44, 0.07, 0.5), body)
    s.block((0, -0.23, 0.46), (0.06, 0.04, 0.16), steel, skip=("top", "bottom"))
    for side in (-1, 1):
        s.board((side * 0.26, 0.0, 0.64), (0.05, 0.26, 0.03), steel)
        s.block((side * 0.26, 0.0, 0.50), (0.03, 0.04, 0.14), steel, skip=("top", "bottom"))
    seat = Slot("on", (-0.21, -0.16, 0.52), (0.21, 0.21, 0.95), "seat")
    return Model("office chair", color, s, slots=(seat,), contact="none")


def stool(rng: np.random.Generator) -> Model:
    """Round seat on four slanted legs."""
    color = pick(rng, "brown", "white", "red", "yellow", "blue", "black")
    paint = wood(color, rng) if color == "brown" else flat(color, rng)
    h, r, s = float(rng.uniform(0.42, 0.62)), 0.17, Shape()
    for k in range(4):
        angle = np.pi / 2 * (k + 0.5)
        x, y = np.cos(angle), np.sin(angle)
        s.rod((0.16 * x, 0.16 * y, 0.0), (-0.05 * x, -0.05 * y, h), 0.017, paint, caps="none")
    s.tube((0, 0, h), r, 0.04, paint)
    return Model("stool", color, s, slots=(Slot("on", (-0.1, -0.1, h + 0.04), (0.1, 0.1, h + 0.4)),), contact="none")


def bench(rng: np.random.Generator) -> Model:
    """Long seat without a back, open beneath."""
    color = pick(rng, "brown", "white", "gray", "green")
    paint = wood(color, rng)
    w, d, h, s = float(rng.uniform(0.95, 1.2)), 0.36, 0.45, Shape()
    s.board((0, 0, h - 0.05), (w, d, 0.05), paint)
    for side in (-1, 1):
        s.board((side * (w / 2 - 0.05), 0, 0), (0.05, d - 0.04, h - 0.05), paint)
    on = Slot("on", (-w / 2 + 0.05, -d / 2 + 0.03, h), (w / 2 - 0.05, d / 2 - 0.03, h + 0.5))
    under = Slot("under", (-w / 2 + 0.12, -d / 2 + 0.02, 0.0), (w / 2 - 0.12, d / 2 - 0.02, h - 0.08))
    return Model("bench", color, s, slots=(on, under), contact="none")


def ottoman(rng: np.random.Generator) -> Model:
    """Padded footstool."""
    color = pick(rng, *FABRIC_COLORS)
    s, h = Shape(), float(rng.uniform(0.36, 0.44))
    body = cloth(color, rng)
    if rng.random() < 0.5:
        s.tube((0, 0, 0), 0.28, h, body, caps="top")
    else:
        s.block((0, 0, 0), (0.6, 0.48, h), body, skip=("bottom",))
    return Model("ottoman", color, s, slots=(Slot("on", (-0.18, -0.18, h), (0.18, 0.18, h + 0.4)),))
