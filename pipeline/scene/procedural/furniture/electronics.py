"""Screens and machines; some are on or off, laptops open or closed."""

from __future__ import annotations

import numpy as np

from pipeline.scene.procedural.paint import Paint, flat, lit, metal, pick, wood
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Model, Slot

SCREEN_BLUE = (0.35, 0.66, 0.98)
"""A lit screen, seen against the black of one that is off."""


def _screen(on: bool, rng: np.random.Generator) -> Paint:
    return lit(SCREEN_BLUE) if on else metal("black", rng)


def _states(on: bool) -> tuple[str, ...]:
    return ("on",) if on else ("off",)


def tv(rng: np.random.Generator) -> Model:
    """Flat television on two feet; while it is on, no one colour fits."""
    on, s = rng.random() < 0.5, Shape()
    w, h, dark = float(rng.uniform(0.9, 1.15)), 0.58, flat("black", rng)
    s.board((0, -0.01, 0.06), (w, 0.05, h), dark)
    s.board((0, 0.02, 0.08), (w - 0.05, 0.012, h - 0.05), _screen(on, rng))
    for side in (-1, 1):
        s.board((side * w * 0.3, 0, 0), (0.04, 0.2, 0.06), dark)
    return Model("tv", "" if on else "black", s, _states(on), contact="none")


def monitor(rng: np.random.Generator) -> Model:
    """Computer screen on a stand; while it is on, no one colour fits."""
    on, s, body = rng.random() < 0.5, Shape(), flat("black", rng)
    s.board((0, -0.03, 0), (0.22, 0.16, 0.015), body)
    s.board((0, -0.06, 0.015), (0.05, 0.03, 0.14), body)
    s.board((0, -0.03, 0.12), (0.54, 0.035, 0.34), body)
    s.board((0, -0.009, 0.14), (0.50, 0.01, 0.30), _screen(on, rng))
    return Model("monitor", "" if on else "black", s, _states(on))


def laptop(rng: np.random.Generator) -> Model:
    """Laptop, open with a lit screen, or closed."""
    opened, color, s = rng.random() < 0.5, pick(rng, "gray", "black", "white", "red"), Shape()
    body = metal(color, rng)
    s.board((0, 0, 0), (0.34, 0.24, 0.018), body)
    if not opened:
        s.board((0, 0, 0.018), (0.34, 0.24, 0.012), body)
        return Model("laptop", color, s, ("closed",))
    s.board((0, 0.015, 0.018), (0.24, 0.08, 0.003), flat("black" if color != "black" else "gray", rng))
    lid = Shape()
    lid.board((0, 0.115, 0), (0.34, 0.23, 0.012), body)
    lid.board((0, 0.115, -0.004), (0.25, 0.14, 0.004), lit(SCREEN_BLUE))
    s.merge(lid, at=(0, -0.11, 0.02), tilt=1.85)
    return Model("laptop", color, s, ("open", "on"))


def keyboard(rng: np.random.Generator) -> Model:
    """Computer keyboard."""
    color, s = pick(rng, "black", "white", "gray"), Shape()
    s.board((0, 0, 0), (0.42, 0.14, 0.022), flat(color, rng))
    keys = flat({"black": "gray", "white": "gray", "gray": "black"}[color], rng)
    for row in range(4):
        s.board((0, -0.048 + 0.032 * row, 0.022), (0.34, 0.012, 0.005), keys)
    return Model("keyboard", color, s)


def mouse(rng: np.random.Generator) -> Model:
    """Computer mouse."""
    color, s = pick(rng, "black", "white", "red", "blue"), Shape()
    s.ball((0, 0, 0.018), (0.032, 0.055, 0.018), flat(color, rng))
    return Model("mouse", color, s)


def computer_tower(rng: np.random.Generator) -> Model:
    """Desktop computer."""
    color, s = pick(rng, "black", "gray", "white"), Shape()
    s.block((0, 0, 0), (0.2, 0.42, 0.42), metal(color, rng), skip=("bottom",))
    s.board((0, 0.212, 0.32), (0.15, 0.006, 0.05), flat("black" if color != "black" else "gray", rng))
    s.board((0, 0.214, 0.2), (0.03, 0.006, 0.03), lit((0.4, 0.9, 0.5)))
    return Model("computer tower", color, s)


def printer(rng: np.random.Generator) -> Model:
    """Desktop printer with paper in its tray."""
    color, s = pick(rng, "white", "black", "gray"), Shape()
    s.block((0, 0, 0), (0.42, 0.34, 0.2), flat(color, rng), skip=("bottom",))
    s.board((0, 0.175, 0.05), (0.3, 0.02, 0.05), flat("black" if color != "black" else "gray", rng))
    s.board((0, 0.21, 0.04), (0.22, 0.1, 0.01), flat("white", rng))
    return Model("printer", color, s)


def speaker(rng: np.random.Generator) -> Model:
    """Loudspeaker with two cones."""
    color, s = pick(rng, "black", "brown", "white", "gray"), Shape()
    h = float(rng.uniform(0.26, 0.34))
    s.block((0, 0, 0), (0.18, 0.18, h), wood(color, rng) if color == "brown" else flat(color, rng), skip=("bottom",))
    ring = flat("gray" if color != "gray" else "black", rng)
    s.rod((0, 0.09, h * 0.32), (0, 0.012, 0), 0.065, ring)
    s.rod((0, 0.09, h * 0.76), (0, 0.012, 0), 0.035, ring)
    return Model("speaker", color, s)


def telephone(rng: np.random.Generator) -> Model:
    """Desk telephone."""
    color, s = pick(rng, "black", "white", "red", "green"), Shape()
    paint = flat(color, rng)
    s.block((0, 0, 0), (0.18, 0.2, 0.06), paint, skip=("bottom",), top=(0.95, 0.8))
    s.board((-0.055, 0, 0.06), (0.05, 0.2, 0.035), paint)
    s.board((0.035, 0, 0.06), (0.08, 0.1, 0.005), flat("gray", rng))
    return Model("telephone", color, s)


def headphones(rng: np.random.Generator) -> Model:
    """Headphones lying on their ear cups."""
    color, s = pick(rng, "black", "white", "red", "blue"), Shape()
    paint = flat(color, rng)
    for side in (-1, 1):
        s.tube((side * 0.08, 0, 0), 0.042, 0.04, paint)
    for k in range(8):
        a, b = np.pi * k / 8, np.pi * (k + 1) / 8
        start = (0.08 * np.cos(a), -0.03 - 0.1 * np.sin(a), 0.025)
        s.rod(start, (0.08 * (np.cos(b) - np.cos(a)), -0.1 * (np.sin(b) - np.sin(a)), 0.0), 0.012, paint, caps="none")
    return Model("headphones", color, s)


def keyboard_piano(rng: np.random.Generator) -> Model:
    """Electric piano on a stand."""
    color, s, h = pick(rng, "black", "white", "gray"), Shape(), 0.72
    s.board((0, 0, h), (1.1, 0.3, 0.09), flat(color, rng))
    s.board((0, 0.07, h + 0.09), (1.0, 0.13, 0.006), flat("white" if color != "white" else "black", rng))
    leg = metal("gray", rng)
    for side in (-1, 1):
        s.block((side * 0.42, 0, 0), (0.04, 0.28, 0.03), leg)
        s.block((side * 0.42, 0, 0.03), (0.04, 0.06, h - 0.03), leg, skip=("top", "bottom"))
    under = Slot("under", (-0.37, -0.13, 0.0), (0.37, 0.13, h - 0.05))
    return Model("keyboard piano", color, s, slots=(under,), contact="none")


def fan(rng: np.random.Generator) -> Model:
    """Standing fan."""
    color, s = pick(rng, "white", "black", "blue", "gray"), Shape()
    paint = flat(color, rng)
    s.tube((0, 0, 0), 0.18, 0.03, paint, caps="top")
    s.tube((0, 0, 0.03), 0.018, 0.9, paint, caps="none")
    s.rod((0, -0.06, 1.05), (0, 0.08, 0), 0.05, paint)
    s.rod((0, 0.03, 1.05), (0, 0.05, 0), 0.19, paint)
    blade = flat("gray" if color != "gray" else "black", rng)
    for k in range(3):
        angle = 2 * np.pi * k / 3
        s.rod((0, 0.086, 1.05), (0.16 * np.cos(angle), 0, 0.16 * np.sin(angle)), 0.028, blade)
    return Model("fan", color, s)
