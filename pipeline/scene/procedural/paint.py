"""What a surface looks like before light: a basic colour, a solid texture, gloss and glow."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

RGB = tuple[float, float, float]

PALETTE: dict[str, RGB] = {
    "black": (0.075, 0.075, 0.085),
    "white": (0.97, 0.97, 0.96),
    "gray": (0.53, 0.535, 0.545),
    "red": (0.80, 0.11, 0.11),
    "green": (0.15, 0.56, 0.20),
    "blue": (0.13, 0.33, 0.80),
    "yellow": (0.97, 0.85, 0.13),
    "orange": (0.99, 0.52, 0.07),
    "purple": (0.50, 0.18, 0.66),
    "pink": (0.98, 0.58, 0.74),
    "brown": (0.46, 0.28, 0.14),
}
"""sRGB of the basic colours, chosen so that shading and texture leave the name unchanged."""

HUE_SPREAD = 0.025
"""Standard deviation, per channel, of one object's colour about its palette entry."""


class Texture(IntEnum):
    """Patterns of the position on a surface."""

    PLAIN = 0
    """Nearly even, with a little noise."""
    WOOD = 1
    """Grain along the longer way."""
    TILES = 2
    """Square tiles of slightly different brightness with dark joints."""
    CHECKS = 3
    """Two tones in squares."""
    STRIPES = 4
    """Two tones in bands."""
    FABRIC = 5
    """Coarse noise."""
    PLANKS = 6
    """Boards of different tone with dark joints, as on a floor."""


@dataclass(frozen=True, slots=True)
class Paint:
    """Finish of a surface; equal paints are stored once."""

    color: RGB
    """sRGB, 0 to 1."""
    texture: Texture = Texture.PLAIN
    """Pattern."""
    period_m: float = 0.3
    """Length of the pattern, metres."""
    contrast: float = 0.05
    """Strength of the pattern: 0.1 changes brightness by up to 10 %."""
    gloss: float = 0.03
    """Height of the view-dependent highlight, as a share of full white."""
    glow: float = 0.0
    """1 for a surface that shines by itself and takes no shading, 0 for one that does not."""


def mix(color: str, rng: np.random.Generator, spread: float = HUE_SPREAD) -> RGB:
    """Return a shade of the named basic colour; black, white and gray stay free of hue."""
    shift = rng.normal(0.0, spread, 3).clip(-2 * spread, 2 * spread)
    if color in ("black", "white", "gray"):
        shift = 0.15 * shift + 0.85 * shift.mean()
    rgb = np.clip(np.array(PALETTE[color]) + shift, 0.02, 0.99)
    return (float(rgb[0]), float(rgb[1]), float(rgb[2]))


def flat(color: str, rng: np.random.Generator) -> Paint:
    """Return a painted or plastic finish."""
    return Paint(mix(color, rng), gloss=0.04)


def metal(color: str, rng: np.random.Generator) -> Paint:
    """Return a glossy finish."""
    return Paint(mix(color, rng, 0.01), contrast=0.03, gloss=0.12)


def wood(color: str, rng: np.random.Generator) -> Paint:
    """Return a finish with grain."""
    return Paint(mix(color, rng), Texture.WOOD, float(rng.uniform(0.10, 0.2)), 0.14, 0.03)


def cloth(color: str, rng: np.random.Generator) -> Paint:
    """Return a fabric: noise, and at times stripes or checks."""
    kind = Texture(int(rng.choice([Texture.FABRIC, Texture.FABRIC, Texture.FABRIC, Texture.STRIPES, Texture.CHECKS])))
    return Paint(mix(color, rng), kind, float(rng.uniform(0.08, 0.16)), 0.10, 0.0)


def lit(color: RGB = (1.0, 0.97, 0.72)) -> Paint:
    """Return a surface that shines by itself."""
    return Paint(color, contrast=0.0, gloss=0.0, glow=1.0)


def pick(rng: np.random.Generator, *colors: str) -> str:
    """Return one of the colour names."""
    return str(colors[int(rng.integers(len(colors)))])
