"""Things that stand on the floor: plants, bags, instruments, cleaning gear."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.furniture.small import BRIGHT
from pipeline.scene.procedural.paint import Paint, Texture, cloth, flat, metal, mix, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot


def _leaves(s: Shape, z: float, reach: float, count: int, rng: np.random.Generator) -> None:
    for k in range(count):
        angle, rise = 2 * np.pi * k / count + rng.uniform(-0.3, 0.3), rng.uniform(0.3, 1.1)
        green = Paint(mix("green", rng, 0.03), Texture.FABRIC, 0.1, 0.15, 0.04)
        radius = reach * rng.uniform(0.45, 0.6)
        at = (reach * 0.45 * np.cos(angle), reach * 0.45 * np.sin(angle), z + reach * rise * 0.7)
        s.ball(at, (radius * 0.8, radius * 0.8, radius * 0.75), green)


def potted_plant(rng: np.random.Generator) -> Model:
    """Big plant in a pot on the floor."""
    s, h = Shape(), float(rng.uniform(0.26, 0.34))
    s.tube((0, 0, 0), 0.13, h, flat(pick(rng, "brown", "white", "orange", "blue", "gray"), rng), tip=1.3, caps="none")
    s.tube((0, 0, h - 0.03), 0.16, 0.01, flat("brown", rng), caps="top")
    stem = float(rng.uniform(0.1, 0.5))
    s.tube((0, 0, h - 0.03), 0.02, stem + 0.15, wood("brown", rng), caps="none")
    _leaves(s, h + stem, float(rng.uniform(0.28, 0.36)), 7, rng)
    return Model("potted plant", "green", s)


def plant(rng: np.random.Generator) -> Model:
    """Small plant for tables and sills."""
    s = Shape()
    s.tube((0, 0, 0), 0.045, 0.09, flat(pick(rng, "brown", "white", "orange", "red"), rng), tip=1.25, caps="none")
    s.tube((0, 0, 0.075), 0.05, 0.005, flat("brown", rng), caps="top")
    _leaves(s, 0.09, 0.11, 6, rng)
    return Model("plant", "green", s)


def backpack(rng: np.random.Generator) -> Model:
    """Backpack with a front pocket."""
    color, s = pick(rng, *BRIGHT, "black", "gray"), Shape()
    body = cloth(color, rng)
    s.block((0, -0.02, 0), (0.32, 0.18, 0.34), body, skip=("bottom",))
    s.block((0, -0.02, 0.34), (0.32, 0.18, 0.1), body, skip=("bottom",), top=(0.7, 0.6))
    s.block((0, 0.1, 0.03), (0.24, 0.06, 0.18), cloth("black" if color != "black" else "gray", rng), top=(0.95, 0.7))
    return Model("backpack", color, s)


def guitar(rng: np.random.Generator) -> Model:
    """Guitar upright on a small stand, its sound hole to the front."""
    color, s = pick(rng, "brown", "red", "black", "orange", "blue"), Shape()
    body, dark = wood(color, rng), flat("black" if color != "black" else "gray", rng)
    s.rod((0, -0.05, 0.24), (0, 0.1, 0), 0.2, body)
    s.rod((0, -0.05, 0.52), (0, 0.1, 0), 0.145, body)
    s.rod((0, 0.051, 0.44), (0, 0.004, 0), 0.05, dark)
    s.board((0, 0.045, 0.6), (0.05, 0.03, 0.4), wood("brown", rng))
    s.board((0, 0.04, 1.0), (0.07, 0.03, 0.12), dark)
    for side in (-1, 1):
        s.rod((side * 0.12, -0.1, 0.0), (0, 0.12, 0.06), 0.015, metal("black", rng))
    return Model("guitar", color, s)


def dumbbell(rng: np.random.Generator) -> Model:
    """Dumbbell."""
    color, s, r = pick(rng, "black", "blue", "pink", "purple", "gray"), Shape(), float(rng.uniform(0.05, 0.07))
    s.rod((-0.08, 0, r), (0.16, 0, 0), 0.016, metal("gray", rng))
    for x in (-0.15, 0.07):
        s.rod((x, 0, r), (0.08, 0, 0), r, flat(color, rng))
    return Model("dumbbell", color, s)


def broom(rng: np.random.Generator) -> Model:
    """Broom standing upright."""
    color, s = pick(rng, "red", "blue", "green", "yellow", "orange"), Shape()
    s.block((0, 0, 0), (0.3, 0.08, 0.14), flat(color, rng), skip=("bottom",), top=(0.7, 0.6))
    s.tube((0, 0, 0.14), 0.014, 1.1, flat(color, rng), caps="top")
    return Model("broom", color, s)


def vacuum_cleaner(rng: np.random.Generator) -> Model:
    """Upright vacuum cleaner."""
    color, s = pick(rng, "red", "blue", "purple", "green", "black"), Shape()
    dark = flat("black" if color != "black" else "gray", rng)
    s.block((0, 0.08, 0), (0.28, 0.22, 0.09), flat(color, rng), skip=("bottom",))
    s.rod((0, 0.02, 0.08), (0, -0.12, 0.5), 0.075, flat(color, rng))
    s.rod((0, -0.1, 0.58), (0, -0.1, 0.42), 0.016, dark)
    s.board((0, -0.21, 0.98), (0.03, 0.07, 0.05), dark)
    return Model("vacuum cleaner", color, s)


def ladder(rng: np.random.Generator) -> Model:
    """Folding ladder, closed, upright and slim."""
    color, s, h = pick(rng, "gray", "yellow", "red"), Shape(), 1.45
    paint = metal(color, rng)
    for side in (-1, 1):
        s.block((side * 0.2, 0, 0), (0.035, 0.07, h), paint, skip=("bottom",))
    for k in range(6):
        s.board((0, 0, 0.18 + 0.22 * k), (0.37, 0.06, 0.025), paint)
    return Model("ladder", color, s, ("closed",), contact="none")


def coat_rack(rng: np.random.Generator) -> Model:
    """Stand with hooks and a coat on it."""
    color, s = pick(rng, "brown", "black", "white"), Shape()
    pole = wood(color, rng)
    s.tube((0, 0, 0), 0.19, 0.03, pole, caps="top")
    s.tube((0, 0, 0.03), 0.025, 1.65, pole, caps="top")
    for k in range(4):
        angle = np.pi / 2 * k + 0.4
        s.rod((0, 0, 1.55), (0.16 * np.cos(angle), 0.16 * np.sin(angle), 0.08), 0.014, pole)
    return Model("coat rack", color, s)


def paper_bag(rng: np.random.Generator) -> Model:
    """Paper bag, open at the top."""
    s = Shape()
    s.hollow((0, 0, 0), (0.28, 0.18, 0.34), 0.008, flat("brown", rng))
    return Model("paper bag", "brown", s, ("open",), (Slot("in", (-0.12, -0.07, 0.01), (0.12, 0.07, 0.36)),))


def bicycle(rng: np.random.Generator) -> Model:
    """Bicycle on its stand, along x."""
    color, s, r = pick(rng, "red", "blue", "green", "black", "orange"), Shape(), 0.32
    paint, tyre = metal(color, rng), flat("black", rng)
    for x in (-0.5, 0.5):
        for k in range(16):
            a, b = 2 * np.pi * k / 16, 2 * np.pi * (k + 1) / 16
            step = (r * (np.cos(b) - np.cos(a)), 0.0, r * (np.sin(b) - np.sin(a)))
            s.rod((x + r * np.cos(a), 0, r + 0.025 + r * np.sin(a)), step, 0.022, tyre, caps="none")
        s.rod((x, -0.04, r + 0.025), (0, 0.08, 0), 0.03, metal("gray", rng))
    joints = {
        "rear": (-0.5, 0.345),
        "front": (0.5, 0.345),
        "crank": (-0.08, 0.3),
        "seat": (-0.2, 0.82),
        "head": (0.36, 0.8),
    }
    bars = (
        ("rear", "crank"),
        ("rear", "seat"),
        ("crank", "seat"),
        ("crank", "head"),
        ("seat", "head"),
        ("head", "front"),
    )
    for start, end in bars:
        (xa, za), (xb, zb) = joints[start], joints[end]
        s.rod((xa, 0, za), (xb - xa, 0, zb - za), 0.022, paint)
    s.board((-0.21, 0, 0.86), (0.24, 0.12, 0.05), flat("black" if color != "black" else "gray", rng))
    s.rod((0.36, 0, 0.8), (-0.02, 0, 0.17), 0.018, paint)
    s.rod((0.34, -0.24, 0.97), (0, 0.48, 0), 0.018, flat("black", rng))
    return Model("bicycle", color, s, contact="none")


def piano(rng: np.random.Generator) -> Model:
    """Upright piano with its keys showing."""
    color, s = pick(rng, "black", "brown", "white"), Shape()
    paint = wood(color, rng) if color == "brown" else metal(color, rng)
    w, h = 1.35, 1.12
    s.block((0, -0.14, 0), (w, 0.28, h), paint, skip=("bottom",))
    s.board((0, 0.11, 0.6), (w, 0.22, 0.1), paint)
    s.board((0, 0.12, 0.7), (w - 0.14, 0.16, 0.015), flat("white" if color != "white" else "black", rng))
    for side in (-1, 1):
        s.block((side * (w / 2 - 0.05), 0.17, 0), (0.08, 0.08, 0.6), paint, skip=("bottom", "top"))
    on = Slot("on", (-w / 2 + 0.05, -0.25, h), (w / 2 - 0.05, -0.03, h + 0.5))
    return Model("piano", color, s, slots=(on,))


def fireplace(rng: np.random.Generator) -> Model:
    """Mantelpiece with a dark hearth; its top takes things."""
    color, s = pick(rng, "white", "gray", "brown"), Shape()
    paint = Paint(mix(color, rng), Texture.TILES, 0.2, 0.15, 0.02)
    w, d, h = 1.2, 0.36, 1.05
    for side in (-1, 1):
        s.block((side * (w / 2 - 0.15), 0, 0), (0.3, d, h - 0.3), paint, skip=("bottom",))
    s.block((0, 0, h - 0.3), (w, d, 0.24), paint)
    s.board((0, 0, h - 0.06), (w + 0.08, d, 0.06), paint)
    s.block((0, -d / 2 + 0.03, 0), (w - 0.6, 0.06, h - 0.3), flat("black", rng), skip=("bottom",))
    for k in range(3):
        s.rod((-0.18, -0.04 + 0.06 * k, 0.05 + 0.05 * (k == 1)), (0.36, 0, 0), 0.04, wood("brown", rng))
    on = Slot("on", (-w / 2 + 0.05, -d / 2 + 0.05, h), (w / 2 - 0.05, d / 2 - 0.04, h + 0.5))
    return Model("fireplace", color, s, slots=(on,))
