"""Open things one looks into, and closed ones that look alike from the side."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.paint import Paint, Texture, flat, metal, mix, pick
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot

BOX_COLORS = ("brown", "brown", "blue", "red", "green", "yellow", "white", "gray", "purple", "orange", "pink", "black")


def wicker(color: str, rng: np.random.Generator) -> Paint:
    """Return a woven finish."""
    return Paint(mix(color, rng), Texture.CHECKS, 0.05, 0.14, 0.0)


def _inside(w: float, d: float, bottom: float, top: float, wall: float) -> Slot:
    return Slot(
        "in", (-w / 2 + wall + 0.01, -d / 2 + wall + 0.01, bottom), (w / 2 - wall - 0.01, d / 2 - wall - 0.01, top)
    )


def box(rng: np.random.Generator) -> Model:
    """Box, open at the top or closed by a lid."""
    color, s = pick(rng, *BOX_COLORS), Shape()
    w, d, h = (float(v) for v in rng.uniform((0.28, 0.24, 0.13), (0.44, 0.36, 0.22)))
    paint = flat(color, rng)
    if rng.random() < 0.65:
        s.hollow((0, 0, 0), (w, d, h), 0.012, paint)
        return Model("box", color, s, ("open",), (_inside(w, d, 0.012, h + 0.22, 0.012),), contact="rectangle")
    s.block((0, 0, 0), (w - 0.02, d - 0.02, h - 0.05), paint, skip=("bottom", "top"))
    s.block((0, 0, h - 0.05), (w, d, 0.05), paint)
    return Model(
        "box",
        color,
        s,
        ("closed",),
        (Slot("on", (-w / 2 + 0.03, -d / 2 + 0.03, h), (w / 2 - 0.03, d / 2 - 0.03, h + 0.3)),),
        contact="rectangle",
    )


def storage_container(rng: np.random.Generator) -> Model:
    """Low plastic tub that fits under a bed."""
    color, s = pick(rng, "blue", "white", "gray", "green", "red", "orange"), Shape()
    w, d, h = 0.46, 0.34, 0.2
    s.hollow((0, 0, 0), (w, d, h), 0.015, flat(color, rng))
    return Model(
        "storage container", color, s, ("open",), (_inside(w, d, 0.015, h + 0.02, 0.015),), contact="rectangle"
    )


def basket(rng: np.random.Generator) -> Model:
    """Woven basket, open at the top."""
    color, s = pick(rng, "brown", "brown", "white", "gray", "orange"), Shape()
    w, d, h = float(rng.uniform(0.34, 0.44)), 0.32, float(rng.uniform(0.15, 0.22))
    s.hollow((0, 0, 0), (w, d, h), 0.018, wicker(color, rng))
    return Model("basket", color, s, ("open",), (_inside(w, d, 0.018, h + 0.22, 0.018),), contact="rectangle")


def laundry_basket(rng: np.random.Generator) -> Model:
    """Tall open basket for washing."""
    color, s = pick(rng, "white", "blue", "green", "pink", "gray"), Shape()
    w, d, h = 0.46, 0.38, float(rng.uniform(0.3, 0.38))
    s.hollow((0, 0, 0), (w, d, h), 0.018, wicker(color, rng))
    return Model("laundry basket", color, s, ("open",), (_inside(w, d, 0.018, h + 0.1, 0.018),), contact="rectangle")


def crate(rng: np.random.Generator) -> Model:
    """Slatted wooden crate, open at the top."""
    color, s = pick(rng, "brown", "red", "blue", "green"), Shape()
    w, d, h = 0.46, 0.36, 0.3
    paint = flat(color, rng)
    s.board((0, 0, 0), (w, d, 0.015), paint)
    for k in range(3):
        z = 0.02 + 0.1 * k
        for side in (-1, 1):
            s.board((0, side * (d / 2 - 0.008), z), (w, 0.016, 0.08), paint)
            s.board((side * (w / 2 - 0.008), 0, z), (0.016, d - 0.04, 0.08), paint)
    return Model("crate", color, s, ("open",), (_inside(w, d, 0.016, h + 0.15, 0.02),), contact="rectangle")


def trash_can(rng: np.random.Generator) -> Model:
    """Round bin, open at the top and wider there."""
    color, s = pick(rng, "black", "gray", "white", "green", "blue", "red"), Shape()
    h, r = float(rng.uniform(0.24, 0.34)), 0.13
    paint = flat(color, rng)
    s.tube((0, 0, 0), r, h, paint, tip=1.25, caps="bottom")
    s.tube((0, 0, 0.015), r * 0.93, h - 0.02, paint, tip=1.27, caps="bottom")
    return Model("trash can", color, s, ("open",), (Slot("in", (-0.09, -0.09, 0.02), (0.09, 0.09, h + 0.12)),))


def bucket(rng: np.random.Generator) -> Model:
    """Bucket with a handle lying on its rim."""
    color, s = pick(rng, "blue", "red", "yellow", "green", "gray"), Shape()
    paint = flat(color, rng)
    s.tube((0, 0, 0), 0.11, 0.26, paint, tip=1.3, caps="bottom")
    s.tube((0, 0, 0.015), 0.10, 0.24, paint, tip=1.33, caps="bottom")
    return Model("bucket", color, s, ("open",), (Slot("in", (-0.065, -0.065, 0.02), (0.065, 0.065, 0.3)),))


def tray(rng: np.random.Generator) -> Model:
    """Shallow tray with a rim."""
    color, s = pick(rng, "brown", "white", "black", "red", "green"), Shape()
    s.hollow((0, 0, 0), (0.4, 0.28, 0.03), 0.008, flat(color, rng))
    return Model("tray", color, s, slots=(Slot("on", (-0.18, -0.12, 0.008), (0.18, 0.12, 0.35)),))


def suitcase(rng: np.random.Generator) -> Model:
    """Upright hard suitcase with a handle."""
    color, s = pick(rng, "red", "blue", "black", "green", "purple", "orange"), Shape()
    w, d, h = float(rng.uniform(0.4, 0.46)), 0.25, float(rng.uniform(0.55, 0.68))
    s.block((0, 0, 0.04), (w, d, h), flat(color, rng))
    dark = metal("black" if color != "black" else "gray", rng)
    for side in (-1, 1):
        s.board((side * w * 0.2, d / 2, 0.06), (0.02, 0.006, h - 0.04), dark)
        for y in (-1, 1):
            s.ball((side * (w / 2 - 0.05), y * (d / 2 - 0.05), 0.022), 0.022, dark)
        s.tube((side * 0.08, -0.06, h + 0.04), 0.01, 0.14, dark, caps="none")
    s.board((0, -0.06, h + 0.16), (0.18, 0.03, 0.025), dark)
    return Model("suitcase", color, s)


def flat_suitcase(rng: np.random.Generator) -> Model:
    """Suitcase lying on its side: fits under a bed."""
    color, s = pick(rng, "red", "blue", "black", "green", "purple", "brown"), Shape()
    s.block((0, 0, 0), (0.6, 0.42, 0.2), flat(color, rng), skip=("bottom",))
    dark = metal("black" if color != "black" else "gray", rng)
    s.board((0, 0.22, 0.08), (0.16, 0.02, 0.03), dark)
    s.board((0, 0.212, 0.1), (0.56, 0.004, 0.008), dark)
    return Model("suitcase", color, s)


def tool_box(rng: np.random.Generator) -> Model:
    """Metal tool box with a handle."""
    color, s = pick(rng, "red", "blue", "yellow", "green"), Shape()
    s.block((0, 0, 0), (0.42, 0.2, 0.14), metal(color, rng), skip=("bottom",))
    s.block((0, 0, 0.14), (0.42, 0.2, 0.06), metal(color, rng), skip=("bottom",), top=(1.0, 0.4))
    s.board((0, 0, 0.22), (0.2, 0.03, 0.02), metal("black", rng))
    return Model("tool box", color, s, ("closed",))
