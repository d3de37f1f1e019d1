"""Basic colour names: the eleven terms that generators put into questions and observers read off pixels.

Names follow hue first, since shading scales a colour and leaves its hue and saturation alone; brightness decides
only where the word itself means brightness: black, gray, white, brown (a dark orange) and pink (a light red).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64

COLOR_NAMES = ("black", "white", "gray", "red", "green", "blue", "yellow", "orange", "purple", "pink", "brown")
"""The eleven basic colour terms of English; ids index this."""

_BLACK, _WHITE, _GRAY, _RED, _GREEN, _BLUE, _YELLOW, _ORANGE, _PURPLE, _PINK, _BROWN = range(len(COLOR_NAMES))

_HUE_BOUNDS = np.array([14.0, 43.0, 68.0, 172.0, 252.0, 298.0, 342.0])
"""Upper hue of red, orange, yellow, green, blue, purple and pink, degrees; beyond the last it is red again."""
_HUE_NAMES = np.array([_RED, _ORANGE, _YELLOW, _GREEN, _BLUE, _PURPLE, _PINK, _RED])

_DARK = 0.14
"""Below this brightness no hue can be told."""


def name_colors(rgb: Float[np.ndarray, "N 3"]) -> Int64[np.ndarray, "N"]:
    """Return the index into `COLOR_NAMES` of each colour.

    Args:
        rgb: sRGB values, 0 to 1; values outside are clipped.
    """
    rgb = np.clip(np.asarray(rgb, np.float64), 0.0, 1.0)
    value = rgb.max(axis=1)
    chroma = value - rgb.min(axis=1)
    saturation = np.divide(chroma, value, out=np.zeros_like(value), where=value > 0)
    hue = _hue_degrees(rgb, value, chroma)
    names = _HUE_NAMES[np.searchsorted(_HUE_BOUNDS, hue, side="right")]

    warm = (names == _RED) & (hue > 4.0) & (hue < 30.0)
    amber = (names == _YELLOW) & (hue < 54.0)
    reddish = (names == _RED) & ~((hue > 9.0) & (hue < 30.0))
    names = np.where((names == _ORANGE) & ((value < 0.68) | (saturation < 0.55)), _BROWN, names)
    names = np.where(warm & ((value < 0.45) | (saturation < 0.6)) & (value < 0.78), _BROWN, names)
    names = np.where(amber & ((value < 0.5) | ((saturation < 0.5) & (value < 0.8))), _BROWN, names)
    names = np.where(reddish & (saturation < 0.5) & (value > 0.5), _PINK, names)
    names = np.where((names == _RED) & (saturation < 0.5) & (value >= 0.78), _PINK, names)
    names = np.where((names == _PINK) & (hue >= 298.0) & (value < 0.55), _PURPLE, names)

    # Warm light tints white paint: a pale yellow or cream still counts as white, a pale pink less so.
    tinted = np.where((hue > 20.0) & (hue < 75.0), 0.24, np.where((hue > 160.0) & (hue < 280.0), 0.18, 0.13))
    colourless = (saturation < tinted) | (chroma < 0.06)
    gray = np.where(value < 0.21, _BLACK, np.where(value >= 0.74, _WHITE, _GRAY))
    return np.where(value < _DARK, _BLACK, np.where(colourless, gray, names)).astype(np.int64)


def name_color(rgb: Float[np.ndarray, "3"]) -> str:
    """Return the basic name of one sRGB colour (0 to 1)."""
    return COLOR_NAMES[int(name_colors(np.asarray(rgb, np.float64)[None])[0])]


def dominant_color(rgbs: Float[np.ndarray, "N 3"]) -> str:
    """Return the name most of the colours carry, or "" for no colours; ties go to the earlier name."""
    if not len(rgbs):
        return ""
    return COLOR_NAMES[int(np.bincount(name_colors(rgbs), minlength=len(COLOR_NAMES)).argmax())]


def _hue_degrees(
    rgb: Float[np.ndarray, "N 3"], value: Float[np.ndarray, "N"], chroma: Float[np.ndarray, "N"]
) -> Float[np.ndarray, "N"]:
    red, green, blue = rgb.T
    safe = np.where(chroma > 0, chroma, 1.0)
    sextant = np.where(
        value == red,
        ((green - blue) / safe) % 6.0,
        np.where(value == green, (blue - red) / safe + 2.0, (red - green) / safe + 4.0),
    )
    return np.where(chroma > 0, 60.0 * sextant, 0.0)
