"""Solid textures: brightness as a function of the position in the object's frame, so that no unwrapping is needed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from pipeline.scene.procedural.paint import Texture

JOINT_M = 0.012
"""Width of the dark joints between tiles and planks."""
ALIAS = 2.5
"""A pattern needs this many samples per period; coarser sampling stretches it instead of scrambling it."""


def brightness(
    texture: Int[np.ndarray, "n"],
    point: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    period_m: Float[np.ndarray, "n"],
    contrast: Float[np.ndarray, "n"],
    spacing_m: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "n"]:
    """Return the factor, about 1, by which the pattern changes the paint's colour.

    Args:
        texture: `Texture` of each point.
        point: Position in the object's own frame.
        normal: Unit normal in the same frame; the pattern lies in the plane of the two other axes.
        period_m: Length of the pattern.
        contrast: Strength of the pattern.
        spacing_m: Distance between samples; finer detail than it allows is widened or faded.
    """
    flat = _planar(point, normal)
    period = np.maximum(period_m, ALIAS * spacing_m)
    ab = flat / period[:, None]
    tone = np.zeros(len(point))
    for kind in np.unique(texture):
        rows = np.flatnonzero(texture == kind)
        tone[rows] = _tone(Texture(int(kind)), ab[rows], flat[rows], period[rows], spacing_m[rows])
    return 1.0 + contrast * tone


def _planar(point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The two coordinates off the axis the normal is closest to; z is always the second where it is in plane."""
    axis = np.abs(normal).argmax(axis=1)
    first, second = np.where(axis == 0, 1, 0), np.where(axis == 2, 1, 2)
    rows = np.arange(len(point))
    return np.stack([point[rows, first], point[rows, second]], axis=1)


def _tone(kind: Texture, ab: np.ndarray, flat: np.ndarray, period: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Pattern in -1 to 1."""
    a, b = ab[:, 0], ab[:, 1]
    if kind == Texture.WOOD:
        grain = b * 2.0 + 0.9 * _noise(a * 0.5, b * 1.5, 1)
        return 0.6 * np.sin(2 * np.pi * grain) + 0.4 * (2 * _noise(a, 4 * b, 2) - 1)
    if kind == Texture.TILES:
        cell = _hash(np.floor(a), np.floor(b), 3) * 2 - 1
        joint = _joint(a, period, spacing) + _joint(b, period, spacing)
        return 0.35 * cell - 1.2 * np.minimum(joint, 1)
    if kind == Texture.CHECKS:
        return np.where((np.floor(a) + np.floor(b)) % 2 == 0, 0.7, -1.0)
    if kind == Texture.STRIPES:
        return np.where(np.floor(a + b * 0.001) % 2 == 0, 0.7, -1.0)
    if kind == Texture.FABRIC:
        return 1.2 * (_noise(a, b, 4) - 0.5) + 0.8 * (_noise(2.7 * a, 2.7 * b, 5) - 0.5)
    if kind == Texture.PLANKS:
        row = np.floor(b)
        along = a / 7.0 + _hash(row, row * 0, 6)
        tone = _hash(row, np.floor(along), 7) * 2 - 1
        return 0.6 * tone + 0.3 * (2 * _noise(a, 3 * b, 8) - 1) - 0.9 * _joint(b, period, spacing)
    return 2 * _noise(a, b, 9) - 1


def _joint(coordinate: np.ndarray, period: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """1 on a joint, 0 off it; where a sample is wider than the joint, its share of the sample."""
    distance = np.abs(coordinate - np.round(coordinate)) * period
    reach = np.maximum(JOINT_M / 2, spacing / 2)
    return (distance < reach) * np.minimum(1.0, JOINT_M / np.maximum(spacing, 1e-6))


def _hash(x: np.ndarray, y: np.ndarray, salt: int) -> np.ndarray:
    """Fixed pseudo-random number in 0 to 1 per lattice point."""
    h = x.astype(np.int64) * 374761393 + y.astype(np.int64) * 668265263 + salt * 2246822519
    h = ((h ^ (h >> 13)) * 1274126177) & 0x7FFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65535.0


def _noise(x: np.ndarray, y: np.ndarray, salt: int) -> np.ndarray:
    """Smooth noise in 0 to 1: hashed lattice values, blended."""
    x0, y0 = np.floor(x), np.floor(y)
    fx, fy = x - x0, y - y0
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    low = _hash(x0, y0, salt) * (1 - fx) + _hash(x0 + 1, y0, salt) * fx
    high = _hash(x0, y0 + 1, salt) * (1 - fx) + _hash(x0 + 1, y0 + 1, salt) * fx
    return low * (1 - fy) + high * fy
