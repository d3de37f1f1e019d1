"""What every splat reader gives: parameters as stored, before unusable Gaussians are dropped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Shaped, UInt8

from pipeline.scene.gaussians import Gaussians, unusable_reasons

SH_C0 = 0.28209479177387814
"""Value of the constant spherical harmonic, sqrt(1 / (4 pi))."""

REST_COUNTS = {0: 0, 1: 3, 2: 8, 3: 15}
"""Spherical-harmonics coefficients per channel beyond the constant one, by degree."""

MIN_SUSPICIOUS = 16
"""Fewer Gaussians than this prove nothing about how their values were stored."""


@dataclass(frozen=True, slots=True)
class RawGaussians:
    """M Gaussians of a file, float32, with the meaning of `pipeline.scene.Gaussians` but any value."""

    means: Float32[np.ndarray, "M 3"]
    """Centres, in the file's units."""
    quats: Float32[np.ndarray, "M 4"]
    """Rotations, wxyz."""
    log_scales: Float32[np.ndarray, "M 3"]
    """Natural logarithm of the standard deviations."""
    opacity_logits: Float32[np.ndarray, "M"]
    """Opacity before the sigmoid."""
    sh: Float32[np.ndarray, "M K 3"]
    """Spherical-harmonics coefficients, then RGB."""
    warnings: tuple[str, ...] = ()
    """What the reader had to assume or leave out."""


def array_at(data: bytes, kind: np.dtype[np.void] | str, count: int, start: int) -> Shaped[np.ndarray, "n"]:
    """Return `count` values at a byte offset, as a view; NumPy refuses to view no bytes at all, this does not."""
    return np.frombuffer(data, kind, count, start) if count else np.empty(0, kind)


def keep_usable(raw: RawGaussians) -> tuple[Gaussians, Bool[np.ndarray, "M"], dict[str, int]]:
    """Return the usable Gaussians, which of the file's they are, and how many were dropped for each reason.

    A Gaussian with several faults counts once, under its first reason.
    """
    bad = np.zeros(len(raw.means), bool)
    dropped: dict[str, int] = {}
    for reason, mask in unusable_reasons(raw.means, raw.quats, raw.log_scales, raw.opacity_logits, raw.sh).items():
        if count := int((mask & ~bad).sum()):
            dropped[reason] = count
            bad |= mask
    kept = ~bad
    arrays = (raw.means, raw.quats, raw.log_scales, raw.opacity_logits, raw.sh)
    return Gaussians(*(array if not dropped else array[kept] for array in arrays)), kept, dropped


def logits_of_bytes(opacity: UInt8[np.ndarray, "M"]) -> Float32[np.ndarray, "M"]:
    """Return opacity logits of opacities stored as 0 to 255; 0 and 255 are exactly transparent and opaque."""
    value = np.arange(256, dtype=np.float64)
    with np.errstate(divide="ignore"):
        table = np.log(value) - np.log(255.0 - value)
    return table.astype(np.float32)[opacity]


def suspicious_values(raw: RawGaussians) -> tuple[str, ...]:
    """Return a line for each sign that values were stored activated, as opacities in 0..1 or scales in metres.

    Trained logits lie on both sides of 0 and indoor log scales are mostly below 0, so a file all of whose
    opacities lie in 0..1, or all of whose log scales are positive, was most likely written after activation.
    """
    if len(raw.means) < MIN_SUSPICIOUS:
        return ()
    lines = []
    if (raw.opacity_logits >= 0).all() and (raw.opacity_logits <= 1).all():
        lines.append("every opacity lies in 0..1: the file seems to hold opacities, not logits")
    if (raw.log_scales > 0).all():
        lines.append("every log scale is above 0: the file seems to hold scales, not their logarithms")
    return tuple(lines)
