"""Bathroom fixtures."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.kitchen import stone
from pipeline.scene.procedural.paint import cloth, flat, metal, pick
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot


def toilet(rng: np.random.Generator) -> Model:
    """Toilet with its lid up (open) or down (closed)."""
    s, white = Shape(), metal("white", rng)
    s.tube((0, 0.05, 0), 0.13, 0.30, white, tip=1.35, caps="none")
    s.block((0, -0.28, 0.36), (0.38, 0.18, 0.40), white)
    s.block((0, -0.16, 0.0), (0.22, 0.3, 0.36), white, skip=("bottom",))
    opened = rng.random() < 0.5
    ring = Shape()
    for k in range(12):
        a, b = 2 * np.pi * k / 12, 2 * np.pi * (k + 1) / 12
        ring.rod(
            (0.17 * np.cos(a), 0.21 * np.sin(a), 0.0),
            (0.17 * (np.cos(b) - np.cos(a)), 0.21 * (np.sin(b) - np.sin(a)), 0.0),
            0.035,
            white,
            caps="none",
        )
    s.merge(ring, at=(0, 0.06, 0.36))
    s.ball((0, 0.06, 0.33), (0.15, 0.19, 0.03), flat("gray", rng))
    lid = Shape()
    lid.board((0, 0.21, 0.0), (0.36, 0.42, 0.025), white)
    s.merge(lid, at=(0, -0.17, 0.40), tilt=1.5 if opened else 0.0)
    s.board((0.12, -0.18, 0.72), (0.05, 0.02, 0.02), metal("gray", rng))
    slots = (Slot("on", (-0.15, -0.35, 0.76), (0.15, -0.21, 1.1)),)
    return Model("toilet", "white", s, ("open",) if opened else ("closed",), slots)


def bathroom_counter(rng: np.random.Generator) -> Model:
    """Vanity: a counter with doors; the basin is a thing of its own that stands on it."""
    color = pick(rng, "white", "brown", "gray", "blue")
    w, d, h, s = float(rng.uniform(0.9, 1.15)), 0.5, 0.82, Shape()
    front = flat(color, rng)
    s.block((0, -0.01, 0), (w, d - 0.03, h - 0.04), front, skip=("bottom",))
    s.board((0, 0, h - 0.04), (w, d, 0.04), stone(pick(rng, "white", "gray", "black"), rng))
    for k in (-1, 1):
        s.board((k * w / 4, d / 2 - 0.015, 0.08), (w / 2 - 0.03, 0.02, h - 0.2), front)
        s.board((k * 0.04, d / 2 + 0.005, 0.45), (0.02, 0.02, 0.12), metal("black", rng))
    basin = Slot("on", (-w / 2 + 0.04, -d / 2 + 0.03, h), (-w / 2 + 0.52, d / 2 - 0.03, h + 0.3), "basin")
    rest = Slot("on", (-w / 2 + 0.54, -d / 2 + 0.05, h), (w / 2 - 0.03, d / 2 - 0.05, h + 0.4))
    return Model("bathroom counter", color, s, slots=(basin, rest))


def basin(rng: np.random.Generator) -> Model:
    """Round wash basin with a tap."""
    s, white, steel = Shape(), metal("white", rng), metal("gray", rng)
    s.tube((0, 0.01, 0), 0.13, 0.13, white, tip=1.5, caps="bottom")
    s.tube((0, 0.01, 0.03), 0.11, 0.10, white, tip=1.55, caps="bottom")
    s.tube((0, -0.18, 0), 0.016, 0.2, steel)
    s.rod((0, -0.18, 0.19), (0, 0.12, -0.01), 0.012, steel)
    return Model("sink", "white", s)


def bathtub(rng: np.random.Generator) -> Model:
    """Tub one looks into from above."""
    s, w, d, h = Shape(), 1.6, 0.72, 0.55
    s.hollow((0, 0, 0), (w, d, h), 0.07, metal("white", rng))
    s.rod((-w / 2 + 0.035, 0, h), (0.12, 0, 0.06), 0.02, metal("gray", rng))
    inside = Slot("in", (-w / 2 + 0.25, -d / 2 + 0.1, 0.07), (w / 2 - 0.1, d / 2 - 0.1, 0.5))
    return Model("bathtub", "white", s, slots=(inside,))


def towel(rng: np.random.Generator) -> Model:
    """Towel on a rail at the wall."""
    color = pick(rng, "white", "blue", "green", "red", "yellow", "pink", "gray", "orange")
    s, w, h = Shape(), float(rng.uniform(0.4, 0.55)), float(rng.uniform(0.55, 0.75))
    s.rod((-w / 2 - 0.05, 0, h), (w + 0.1, 0, 0), 0.012, metal("gray", rng))
    s.block((0, 0, 0), (w, 0.05, h + 0.02), cloth(color, rng))
    return Model("towel", color, s, contact="none")


def toilet_paper(rng: np.random.Generator) -> Model:
    """Roll on a holder at the wall."""
    s = Shape()
    s.rod((-0.055, 0, 0.055), (0.11, 0, 0), 0.055, flat("white", rng))
    s.board((0, -0.055, 0.10), (0.13, 0.02, 0.03), metal("gray", rng))
    return Model("toilet paper", "white", s, contact="none")


def soap_dispenser(rng: np.random.Generator) -> Model:
    """Pump bottle."""
    color, s = pick(rng, "white", "green", "blue", "pink", "orange", "yellow"), Shape()
    s.tube((0, 0, 0), 0.035, 0.12, flat(color, rng), caps="top")
    s.tube((0, 0, 0.12), 0.01, 0.04, flat("gray", rng))
    s.board((0, 0.015, 0.155), (0.02, 0.05, 0.012), flat("gray", rng))
    return Model("soap dispenser", color, s)


def scale(rng: np.random.Generator) -> Model:
    """Bathroom scale on the floor."""
    color, s = pick(rng, "white", "black", "gray", "blue"), Shape()
    s.block((0, 0, 0), (0.3, 0.3, 0.035), metal(color, rng), skip=("bottom",))
    s.board((0, 0.09, 0.035), (0.12, 0.05, 0.004), flat("black" if color != "black" else "white", rng))
    return Model("scale", color, s)


def shower_curtain(rng: np.random.Generator) -> Model:
    """Pleated curtain under a rod; stands at a tub's end."""
    color, s = pick(rng, "blue", "white", "green", "pink", "yellow"), Shape()
    paint, h = cloth(color, rng), 1.95
    for k in range(8):
        s.tube((0, -0.31 + 0.088 * k, 0.0), 0.056, h - 0.03, paint, caps="top")
    s.rod((0, -0.36, h - 0.01), (0, 0.72, 0), 0.012, metal("gray", rng))
    return Model("shower curtain", color, s)
