"""Lamps, on (bright, and they light what is near) or off."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.paint import Paint, cloth, flat, lit, metal, pick
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model

SHADE_COLORS = ("red", "green", "blue", "purple", "orange", "gray", "pink")
"""None is yellow or white, which a lit shade is taken for."""


def _shade(on: bool, color: str, rng: np.random.Generator) -> Paint:
    return lit() if on else cloth(color, rng)


def table_lamp(rng: np.random.Generator) -> Model:
    """Lamp with a base and a conical shade; its colour is the shade's, a bright yellow while it is on."""
    on, color, s = rng.random() < 0.5, pick(rng, *SHADE_COLORS), Shape()
    base = flat(pick(rng, "black", "white", "gray", "brown"), rng)
    s.tube((0, 0, 0), 0.075, 0.02, base, caps="top")
    s.tube((0, 0, 0.02), 0.05, 0.2, base, tip=0.5, caps="none")
    s.tube((0, 0, 0.20), 0.14, 0.2, _shade(on, color, rng), tip=0.6, caps="none")
    s.tube((0, 0, 0.22), 0.115, 0.16, _shade(on, "gray", rng), tip=0.6, caps="top")
    return Model(
        "lamp", "yellow" if on else color, s, ("on",) if on else ("off",), light=(0.0, 0.0, 0.3) if on else None
    )


def floor_lamp(rng: np.random.Generator) -> Model:
    """Tall lamp on a pole; its colour is the shade's, a bright yellow while it is on."""
    on, color, s = rng.random() < 0.5, pick(rng, *SHADE_COLORS), Shape()
    pole = metal(pick(rng, "black", "gray", "brown"), rng)
    s.tube((0, 0, 0), 0.16, 0.03, pole, caps="top")
    s.tube((0, 0, 0.03), 0.02, 1.35, pole, caps="none")
    s.tube((0, 0, 1.36), 0.2, 0.28, _shade(on, color, rng), tip=0.65, caps="none")
    s.tube((0, 0, 1.38), 0.17, 0.24, _shade(on, "gray", rng), tip=0.65, caps="top")
    return Model(
        "lamp", "yellow" if on else color, s, ("on",) if on else ("off",), light=(0.0, 0.0, 1.5) if on else None
    )


def ceiling_light(rng: np.random.Generator) -> Model:
    """Flat round light under the ceiling; its frame hangs from z = 0 downwards."""
    on, s, r = rng.random() < 0.6, Shape(), float(rng.uniform(0.16, 0.24))
    s.tube((0, 0, -0.04), r, 0.04, flat("white", rng))
    s.tube((0, 0, -0.09), r * 0.8, 0.05, lit((1.0, 0.98, 0.86)) if on else flat("gray", rng), tip=1.15, caps="bottom")
    return Model(
        "ceiling light",
        "white" if on else "gray",
        s,
        ("on",) if on else ("off",),
        light=(0.0, 0.0, -0.25) if on else None,
    )


def candle(rng: np.random.Generator) -> Model:
    """Thick candle, burning or not."""
    on, color, s = rng.random() < 0.4, pick(rng, "white", "red", "purple", "green"), Shape()
    h = float(rng.uniform(0.08, 0.16))
    s.tube((0, 0, 0), 0.035, h, flat(color, rng), caps="top")
    s.ball((0, 0, h + 0.02), (0.008, 0.008, 0.02), lit((1.0, 0.8, 0.3)) if on else flat("black", rng))
    return Model("candle", color, s, ("on",) if on else ("off",))
