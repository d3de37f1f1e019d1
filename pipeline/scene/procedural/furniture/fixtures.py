"""Doors, windows and flat things on walls and floors. Wall things have their back on the plane y = 0."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.seating import FABRIC_COLORS
from pipeline.scene.procedural.furniture.small import BRIGHT
from pipeline.scene.procedural.paint import PALETTE, Paint, Texture, cloth, flat, metal, mix, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model

LEAF_M = 0.04
"""Thickness of a door leaf."""
LEAF_DETAIL = 0.7
"""Finer discs on doors, which people pass close by."""


def door(rng: np.random.Generator, width: float, height: float, *, is_open: bool, color: str) -> Model:
    """Return a door leaf from its hinge (x = 0) to x = width, handles on both sides."""
    s, paint, knob = Shape(), wood(color, rng), metal("gray" if color != "gray" else "black", rng)
    s.board((width / 2, 0, 0.01), (width, LEAF_M, height - 0.02), paint)
    s.details = [LEAF_DETAIL] * len(s.details)
    for y in (-1, 1):
        s.board((width - 0.08, y * (LEAF_M / 2 + 0.03), 1.0), (0.12, 0.02, 0.02), knob)
        s.board((width - 0.05, y * (LEAF_M / 2 + 0.01), 0.98), (0.04, 0.02, 0.08), knob)
    return Model("door", color, s, ("open",) if is_open else ("closed",))


def window(rng: np.random.Generator) -> Model:
    """Window with a white frame and a bright sky behind the panes; no one colour fits."""
    s, w, h = Shape(), float(rng.uniform(1.0, 1.5)), float(rng.uniform(1.0, 1.2))
    frame, sky = flat("white", rng), Paint((0.60, 0.79, 0.97), Texture.FABRIC, 0.8, 0.06, 0.0, 1.0)
    s.block((0, 0.012, 0.03), (w - 0.06, 0.024, h - 0.06), sky, skip=("back",))
    for x in (-w / 2 + 0.03, 0.0, w / 2 - 0.03):
        s.board((x, 0.025, 0.0), (0.06, 0.05, h), frame, skip=("back",))
    for z in (0.0, h - 0.06):
        s.board((0, 0.025, z), (w, 0.05, 0.06), frame, skip=("back",))
    s.board((0, 0.06, -0.04), (w, 0.12, 0.04), frame, skip=("back",))
    return Model("window", "", s, contact="rectangle")


def curtain(rng: np.random.Generator) -> Model:
    """One drawn-back, pleated curtain from rod to floor."""
    color, s = pick(rng, *FABRIC_COLORS, "white"), Shape()
    paint, h = cloth(color, rng), 2.2
    for k in range(5):
        s.tube((-0.15 + 0.075 * k, 0.055, 0), 0.052, h - 0.02, paint, caps="top")
    s.rod((-0.2, 0.055, h), (0.4, 0, 0), 0.013, metal("gray", rng))
    return Model("curtain", color, s, ("open",))


def picture(rng: np.random.Generator) -> Model:
    """Framed picture; its colour is the painting's ground."""
    color, s = pick(rng, *BRIGHT, "gray"), Shape()
    w, h = float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.35, 0.6))
    s.board((0, 0.012, 0), (w, 0.024, h), wood(pick(rng, "brown", "black", "white"), rng), skip=("back",))
    s.board((0, 0.026, 0.04), (w - 0.08, 0.008, h - 0.08), flat(color, rng), skip=("back",))
    other = pick(rng, *[c for c in PALETTE if c != color])
    s.rod((w * float(rng.uniform(-0.2, 0.2)), 0.03, h * 0.55), (0, 0.006, 0), h * 0.18, flat(other, rng))
    s.board((0, 0.031, 0.06), (w - 0.16, 0.006, h * 0.18), flat(pick(rng, *PALETTE), rng), skip=("back",))
    return Model("picture", color, s, contact="rectangle")


def poster(rng: np.random.Generator) -> Model:
    """Sheet on the wall with bands of colour."""
    color, s = pick(rng, *BRIGHT, "black"), Shape()
    s.board((0, 0.006, 0), (0.5, 0.012, 0.7), flat(color, rng), skip=("back",))
    s.board((0, 0.014, 0.08), (0.36, 0.004, 0.12), flat("white", rng), skip=("back",))
    return Model("poster", color, s, contact="rectangle")


def mirror(rng: np.random.Generator) -> Model:
    """Mirror: pale gray glass in a frame."""
    s, w, h = Shape(), float(rng.uniform(0.5, 0.7)), float(rng.uniform(0.7, 1.0))
    s.board((0, 0.01, 0), (w, 0.02, h), wood(pick(rng, "brown", "black", "white"), rng), skip=("back",))
    s.board(
        (0, 0.022, 0.03),
        (w - 0.06, 0.006, h - 0.06),
        Paint((0.55, 0.57, 0.59), Texture.FABRIC, 0.5, 0.06, 0.10),
        skip=("back",),
    )
    return Model("mirror", "gray", s, contact="rectangle")


def whiteboard(rng: np.random.Generator) -> Model:
    """Whiteboard with a few strokes on it."""
    s = Shape()
    s.board((0, 0.012, 0), (1.2, 0.024, 0.8), metal("gray", rng), skip=("back",))
    s.board((0, 0.026, 0.03), (1.14, 0.006, 0.74), flat("white", rng), skip=("back",))
    for k in range(3):
        s.board(
            (-0.2, 0.03, 0.25 + 0.15 * k),
            (float(rng.uniform(0.2, 0.5)), 0.003, 0.02),
            flat(pick(rng, "red", "blue"), rng),
            skip=("back",),
        )
    return Model("whiteboard", "white", s, contact="rectangle")


def bulletin_board(rng: np.random.Generator) -> Model:
    """Cork board with notes."""
    s = Shape()
    s.board((0, 0.012, 0), (0.8, 0.024, 0.55), Paint(mix("brown", rng), Texture.FABRIC, 0.06, 0.15), skip=("back",))
    for k in range(4):
        s.board(
            (-0.27 + 0.18 * k, 0.027, float(rng.uniform(0.1, 0.3))),
            (0.1, 0.004, 0.12),
            flat(pick(rng, "white", "yellow", "pink"), rng),
            skip=("back",),
        )
    return Model("bulletin board", "brown", s, contact="rectangle")


def radiator(rng: np.random.Generator) -> Model:
    """Ribbed radiator under a window."""
    s = Shape()
    paint = metal("white", rng)
    s.board((0, 0.05, 0.12), (0.8, 0.05, 0.48), paint)
    for k in range(10):
        s.board((-0.36 + 0.08 * k, 0.085, 0.12), (0.045, 0.03, 0.48), paint)
    return Model("radiator", "white", s, contact="none")


def light_switch(rng: np.random.Generator) -> Model:
    """Switch beside a door."""
    s = Shape()
    s.board((0, 0.006, 0), (0.09, 0.012, 0.09), flat("white", rng))
    s.board((0, 0.014, 0.02), (0.045, 0.006, 0.05), flat("gray", rng))
    return Model("light switch", "white", s, contact="rectangle")


def calendar(rng: np.random.Generator) -> Model:
    """Wall calendar with a coloured head."""
    color, s = "white", Shape()
    s.board((0, 0.006, 0), (0.3, 0.012, 0.42), flat(color, rng))
    s.board((0, 0.014, 0.26), (0.28, 0.004, 0.14), flat(pick(rng, *BRIGHT), rng))
    return Model("calendar", color, s, contact="rectangle")


def fire_extinguisher(rng: np.random.Generator) -> Model:
    """Extinguisher on the floor by the wall."""
    s = Shape()
    s.tube((0, 0, 0), 0.075, 0.42, metal("red", rng), caps="top")
    s.tube((0, 0, 0.42), 0.025, 0.06, metal("black", rng), caps="top")
    s.rod((0.02, 0, 0.45), (0.08, 0, -0.12), 0.012, metal("black", rng))
    return Model("fire extinguisher", "red", s)


def mat(rng: np.random.Generator, width: float, depth: float) -> Model:
    """Return a mat or rug of the given size; nothing stands against it, everything may stand on it."""
    color, s = pick(rng, "red", "blue", "green", "gray", "purple", "orange", "pink"), Shape()
    paint = Paint(mix(color, rng), Texture(int(rng.choice([Texture.CHECKS, Texture.STRIPES]))), 0.25, 0.12, 0.0)
    s.block((0, 0, 0), (width, depth, 0.014), paint, skip=("bottom",))
    return Model("mat", color, s, contact="rectangle")
