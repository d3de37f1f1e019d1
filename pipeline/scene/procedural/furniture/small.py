"""Small things for tables, shelves and the insides of boxes."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.paint import PALETTE, cloth, flat, metal, pick
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model

BRIGHT = ("red", "green", "blue", "yellow", "orange", "purple", "pink")


def book(rng: np.random.Generator) -> Model:
    """Book lying flat."""
    color, s = pick(rng, *BRIGHT, "black", "brown", "white"), Shape()
    w, d, h = float(rng.uniform(0.15, 0.2)), float(rng.uniform(0.21, 0.27)), float(rng.uniform(0.025, 0.05))
    cover = flat(color, rng)
    s.block((0, 0, 0), (w, d, 0.006), cover, skip=("bottom",))
    s.block((0.004, 0, 0.006), (w - 0.012, d - 0.012, h - 0.012), flat("white", rng), skip=("bottom", "top", "left"))
    s.block((-w / 2 + 0.003, 0, 0.006), (0.006, d, h - 0.012), cover, skip=("bottom", "top"))
    s.block((0, 0, h - 0.006), (w, d, 0.006), cover, skip=("bottom",))
    return Model("book", color, s)


def books(rng: np.random.Generator) -> Model:
    """Row of upright books seen as one thing, of many colours."""
    s, x = Shape(), 0.0
    widths = [float(rng.uniform(0.022, 0.05)) for _ in range(int(rng.integers(4, 8)))]
    total = sum(widths)
    for w in widths:
        paint = flat(pick(rng, *PALETTE), rng)
        h, d = float(rng.uniform(0.18, 0.23)), float(rng.uniform(0.13, 0.16))
        s.block((x + w / 2 - total / 2, 0, 0), (w - 0.002, d, h), paint, skip=("bottom",))
        x += w
    return Model("book", "", s)


def cup(rng: np.random.Generator) -> Model:
    """Mug with a handle."""
    color, s = pick(rng, *BRIGHT, "white", "black"), Shape()
    paint = flat(color, rng)
    s.tube((0, 0, 0), 0.042, 0.1, paint, caps="bottom")
    s.tube((0, 0, 0.01), 0.037, 0.088, paint, caps="bottom")
    s.board((0.052, 0, 0.065), (0.024, 0.014, 0.014), paint)
    s.board((0.052, 0, 0.025), (0.024, 0.014, 0.014), paint)
    s.board((0.062, 0, 0.025), (0.012, 0.014, 0.054), paint)
    return Model("cup", color, s)


def bowl(rng: np.random.Generator) -> Model:
    """Bowl, open at the top."""
    color, s = pick(rng, *BRIGHT, "white"), Shape()
    paint = flat(color, rng)
    s.tube((0, 0, 0), 0.055, 0.075, paint, tip=1.8, caps="bottom")
    s.tube((0, 0, 0.01), 0.05, 0.063, paint, tip=1.85, caps="bottom")
    return Model("bowl", color, s)


def plate(rng: np.random.Generator) -> Model:
    """Flat plate."""
    color, s = pick(rng, "white", "white", "blue", "green", "red", "yellow"), Shape()
    s.tube((0, 0, 0), 0.085, 0.022, flat(color, rng), tip=1.4, caps="none")
    s.tube((0, 0, 0.008), 0.1, 0.004, flat(color, rng), caps="top")
    return Model("plate", color, s)


def bottle(rng: np.random.Generator) -> Model:
    """Bottle with a neck."""
    color, s = pick(rng, "green", "brown", "blue", "red", "yellow", "purple"), Shape()
    paint = metal(color, rng)
    s.tube((0, 0, 0), 0.038, 0.17, paint, caps="none")
    s.tube((0, 0, 0.17), 0.038, 0.05, paint, tip=0.4, caps="none")
    s.tube((0, 0, 0.22), 0.015, 0.06, paint, caps="top")
    return Model("bottle", color, s)


def water_bottle(rng: np.random.Generator) -> Model:
    """Sports bottle with a cap."""
    color, s = pick(rng, "blue", "pink", "green", "orange", "black"), Shape()
    s.tube((0, 0, 0), 0.037, 0.19, metal(color, rng), caps="top")
    s.tube((0, 0, 0.19), 0.02, 0.035, flat("black" if color != "black" else "gray", rng), caps="top")
    return Model("water bottle", color, s)


def coffee_kettle(rng: np.random.Generator) -> Model:
    """Kettle with a spout and a lid."""
    color, s = pick(rng, "gray", "red", "black", "blue", "white"), Shape()
    paint = metal(color, rng)
    s.tube((0, 0, 0), 0.1, 0.15, paint, tip=0.75, caps="top")
    s.rod((0.08, 0, 0.08), (0.08, 0, 0.07), 0.018, paint)
    s.ball((0, 0, 0.165), 0.018, flat("black" if color != "black" else "gray", rng))
    s.board((-0.10, 0, 0.06), (0.03, 0.02, 0.10), flat("black" if color != "black" else "gray", rng))
    return Model("coffee kettle", color, s)


def water_pitcher(rng: np.random.Generator) -> Model:
    """Pitcher, open at the top."""
    color, s = pick(rng, "blue", "white", "green", "yellow"), Shape()
    paint = metal(color, rng)
    s.tube((0, 0, 0), 0.065, 0.22, paint, tip=1.15, caps="bottom")
    s.board((-0.095, 0, 0.06), (0.03, 0.02, 0.13), paint)
    return Model("water pitcher", color, s)


def clock(rng: np.random.Generator) -> Model:
    """Round wall clock with a white face; its colour is the rim's."""
    color, s = pick(rng, "black", "red", "blue", "brown", "green"), Shape()
    rim = flat(color, rng)
    s.rod((0, 0, 0.15), (0, 0.04, 0), 0.15, rim, caps="none")
    s.ring((0, 0.04, 0.15), (0, 1, 0), 0.1, 0.15, rim)
    s.ring((0, 0.038, 0.15), (0, 1, 0), 0.0, 0.1, flat("white", rng))
    hand = flat("black", rng)
    s.board((0, 0.05, 0.15), (0.014, 0.006, 0.08), hand)
    s.board((0.03, 0.05, 0.143), (0.06, 0.006, 0.014), hand)
    return Model("clock", color, s)


def alarm_clock(rng: np.random.Generator) -> Model:
    """Small clock with a dark face."""
    color, s = pick(rng, "red", "white", "blue", "yellow", "pink"), Shape()
    s.block((0, 0, 0), (0.14, 0.08, 0.1), flat(color, rng), skip=("bottom",))
    s.board((0, 0.042, 0.03), (0.1, 0.004, 0.045), flat("black", rng))
    return Model("alarm clock", color, s)


def tissue_box(rng: np.random.Generator) -> Model:
    """Box with a tissue sticking out."""
    color, s = pick(rng, "blue", "green", "pink", "purple", "yellow"), Shape()
    s.block((0, 0, 0), (0.23, 0.12, 0.09), flat(color, rng), skip=("bottom",))
    s.block((0, 0, 0.09), (0.1, 0.03, 0.06), flat("white", rng), skip=("bottom",), top=(0.6, 0.3))
    return Model("tissue box", color, s)


def paper(rng: np.random.Generator) -> Model:
    """Stack of sheets."""
    s = Shape()
    s.block((0, 0, 0), (0.21, 0.297, 0.022), flat("white", rng), skip=("bottom",))
    return Model("paper", "white", s)


def paper_towel_roll(rng: np.random.Generator) -> Model:
    """Upright kitchen roll."""
    s = Shape()
    s.tube((0, 0, 0), 0.06, 0.24, flat("white", rng), caps="top")
    s.tube((0, 0, 0.24), 0.02, 0.03, flat("brown", rng), caps="top")
    return Model("paper towel roll", "white", s)


def toilet_roll(rng: np.random.Generator) -> Model:
    """Spare roll of toilet paper."""
    s = Shape()
    s.tube((0, 0, 0), 0.055, 0.1, flat("white", rng), caps="top")
    return Model("toilet paper", "white", s)


def laundry_detergent(rng: np.random.Generator) -> Model:
    """Jug with a cap."""
    color, s = pick(rng, "orange", "blue", "purple", "green"), Shape()
    s.block((0, 0, 0), (0.2, 0.1, 0.22), flat(color, rng), skip=("bottom",), top=(0.8, 0.9))
    s.tube((0.04, 0, 0.22), 0.03, 0.05, flat("white", rng), caps="top")
    return Model("laundry detergent", color, s)


def ball(rng: np.random.Generator) -> Model:
    """Toy ball."""
    color, s, r = pick(rng, *BRIGHT), Shape(), float(rng.uniform(0.07, 0.12))
    s.ball((0, 0, r), r, flat(color, rng))
    return Model("ball", color, s, contact="none")


def hat(rng: np.random.Generator) -> Model:
    """Hat with a brim."""
    color, s = pick(rng, "brown", "black", "red", "blue", "green"), Shape()
    felt = cloth(color, rng)
    s.tube((0, 0, 0), 0.16, 0.015, felt)
    s.tube((0, 0, 0.015), 0.095, 0.11, felt, tip=0.85, caps="top")
    return Model("hat", color, s)


def shoe(rng: np.random.Generator) -> Model:
    """Pair of shoes."""
    color, s = pick(rng, "black", "brown", "white", "red", "blue"), Shape()
    leather, sole = flat(color, rng), flat("white" if color != "white" else "gray", rng)
    for x in (-0.065, 0.065):
        s.block((x, 0, 0), (0.09, 0.27, 0.025), sole, skip=("bottom",))
        s.block((x, -0.06, 0.025), (0.085, 0.14, 0.085), leather, skip=("bottom",), top=(0.8, 0.8))
        s.block((x, 0.07, 0.025), (0.085, 0.12, 0.05), leather, skip=("bottom",), top=(0.8, 0.8))
    return Model("shoe", color, s)


def bag(rng: np.random.Generator) -> Model:
    """Shopping bag with handles."""
    color, s = pick(rng, *BRIGHT, "brown", "white"), Shape()
    paint = flat(color, rng)
    s.block((0, 0, 0), (0.3, 0.13, 0.3), paint, skip=("bottom",), top=(1.05, 0.7))
    for y in (-0.03, 0.03):
        s.board((-0.06, y, 0.3), (0.012, 0.012, 0.1), paint)
        s.board((0.06, y, 0.3), (0.012, 0.012, 0.1), paint)
        s.board((0, y, 0.39), (0.132, 0.012, 0.012), paint)
    return Model("bag", color, s)


def purse(rng: np.random.Generator) -> Model:
    """Handbag with a strap."""
    color, s = pick(rng, "red", "black", "brown", "pink", "purple"), Shape()
    s.block((0, 0, 0), (0.26, 0.1, 0.17), flat(color, rng), skip=("bottom",), top=(0.8, 0.7))
    dark = metal("black" if color != "black" else "gray", rng)
    for side in (-1, 1):
        s.rod((side * 0.08, 0, 0.17), (-side * 0.06, 0, 0.1), 0.008, dark, caps="none")
    s.rod((-0.03, 0, 0.27), (0.06, 0, 0), 0.009, dark)
    return Model("purse", color, s)


def decoration(rng: np.random.Generator) -> Model:
    """Stack of balls as a figurine."""
    color, s = pick(rng, *BRIGHT), Shape()
    s.ball((0, 0, 0.06), 0.06, flat(color, rng))
    s.ball((0, 0, 0.14), 0.034, flat(color, rng))
    s.ball((0, 0, 0.192), 0.022, metal("gray", rng))
    return Model("decoration", color, s)
