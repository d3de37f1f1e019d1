# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Colour names of single 8-bit colours: the rules of `pipeline.scene.color_names`, which is the reference.

A test compares all 16.8 million colours.
"""

from __future__ import annotations

from numba import njit

from pipeline.scene.color_names import COLOR_NAMES

_BLACK, _WHITE, _GRAY, _RED, _GREEN, _BLUE, _YELLOW, _ORANGE, _PURPLE, _PINK, _BROWN = range(len(COLOR_NAMES))


@njit
def name_color(red_level, green_level, blue_level):
    """Return the index into `COLOR_NAMES` of a colour, three uint8."""
    red, green, blue = red_level / 255.0, green_level / 255.0, blue_level / 255.0
    value = max(red, green, blue)
    chroma = value - min(red, green, blue)
    if value < 0.14:
        return _BLACK
    saturation, hue = chroma / value, 0.0
    if chroma > 0.0:
        hue = 60.0 * _sextant(red, green, blue, value, chroma)
    # Warm light tints white paint.
    tinted = 0.24 if 20.0 < hue < 75.0 else 0.18 if 160.0 < hue < 280.0 else 0.13
    if saturation < tinted or chroma < 0.06:
        return _BLACK if value < 0.21 else _WHITE if value >= 0.74 else _GRAY
    return _of_hue(hue, saturation, value)


@njit
def _sextant(red, green, blue, value, chroma):
    if value == red:
        return (green - blue) / chroma + (6.0 if green < blue else 0.0)
    return (blue - red) / chroma + 2.0 if value == green else (red - green) / chroma + 4.0


@njit
def _of_hue(hue, saturation, value):
    if hue < 14.0 or hue >= 342.0:
        if saturation < 0.5 and (value >= 0.78 or (value > 0.5 and not 9.0 < hue < 30.0)):
            return _PURPLE if hue >= 298.0 and value < 0.55 else _PINK
        dull = 4.0 < hue < 30.0 and (value < 0.45 or saturation < 0.6) and value < 0.78
        return _BROWN if dull else _RED
    if hue < 43.0:
        return _BROWN if value < 0.68 or saturation < 0.55 else _ORANGE
    if hue < 68.0:
        amber = hue < 54.0 and (value < 0.5 or (saturation < 0.5 and value < 0.8))
        return _BROWN if amber else _YELLOW
    if hue < 172.0:
        return _GREEN
    if hue < 252.0:
        return _BLUE
    if hue < 298.0:
        return _PURPLE
    return _PURPLE if value < 0.55 else _PINK
