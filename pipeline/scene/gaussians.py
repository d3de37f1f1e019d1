"""The scene as a frozen struct of arrays: M Gaussians with raw (unactivated) parameters, as 3DGS stores them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int, Shaped

from schemas.errors import InputError

SH_COUNTS = {0: 1, 1: 4, 2: 9, 3: 16}
"""Spherical-harmonics coefficients per channel, by degree."""


@dataclass(frozen=True, slots=True)
class Gaussians:
    """M Gaussians; arrays are float32, C-contiguous, read-only and finite.

    Construction checks shapes, types and finiteness; it does not repair. Loaders drop unusable
    Gaussians first with `usable` and report the count by reason.

    Raises:
        InputError: A shape, a type or a value is not as declared.
    """

    means: Float32[np.ndarray, "M 3"]
    """Centres x_j, metres, world frame."""
    quats: Float32[np.ndarray, "M 4"]
    """Rotations, wxyz, any non-zero norm (renderers normalise)."""
    log_scales: Float32[np.ndarray, "M 3"]
    """Natural logarithm of the standard deviation per local axis, metres; -inf is a flat axis."""
    opacity_logits: Float32[np.ndarray, "M"]
    """Opacity before the sigmoid; plus and minus infinity are opacity 1 and 0."""
    sh: Float32[np.ndarray, "M K 3"]
    """Spherical-harmonics coefficients, K = 1, 4, 9 or 16 for degree 0 to 3, then RGB."""

    def __post_init__(self) -> None:
        count = len(self.means)
        sh_count = self.sh.shape[1] if self.sh.ndim == 3 else -1
        expected = {
            "means": (count, 3),
            "quats": (count, 4),
            "log_scales": (count, 3),
            "opacity_logits": (count,),
            "sh": (count, sh_count, 3),
        }
        for name, shape in expected.items():
            array = getattr(self, name)
            if array.shape != shape or (name == "sh" and sh_count not in SH_COUNTS.values()):
                raise InputError("Gaussians", field=name, expected=f"shape {shape}", found=array.shape)
            if array.dtype != np.float32:
                raise InputError("Gaussians", field=name, expected="float32", found=array.dtype)
            frozen = np.ascontiguousarray(array)
            frozen = frozen.view() if frozen.flags.writeable else frozen
            frozen.setflags(write=False)
            object.__setattr__(self, name, frozen)
        reasons = unusable_reasons(self.means, self.quats, self.log_scales, self.opacity_logits, self.sh)
        for reason, bad in reasons.items():
            if bad.any():
                raise InputError(
                    "Gaussians", field=reason, expected="usable values", found=f"{int(bad.sum())} of {count} Gaussians"
                )

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """Degree of the stored spherical harmonics, 0 to 3."""
        return int(np.sqrt(self.sh.shape[1])) - 1

    @property
    def nbytes(self) -> int:
        """Size of all arrays, bytes."""
        return sum(a.nbytes for a in (self.means, self.quats, self.log_scales, self.opacity_logits, self.sh))

    def take(self, ids: Int[np.ndarray, "n"] | Bool[np.ndarray, "M"] | slice) -> Gaussians:
        """Return the Gaussians at `ids` (indices, a mask or a slice), in that order."""
        return Gaussians(self.means[ids], self.quats[ids], self.log_scales[ids], self.opacity_logits[ids], self.sh[ids])


def unusable_reasons(
    means: Shaped[np.ndarray, "M 3"],
    quats: Shaped[np.ndarray, "M 4"],
    log_scales: Shaped[np.ndarray, "M 3"],
    opacity_logits: Shaped[np.ndarray, "M"],
    sh: Shaped[np.ndarray, "M K 3"],
) -> dict[str, Bool[np.ndarray, "M"]]:
    """Return, by reason, which Gaussians no renderer can use; a Gaussian may have several reasons.

    Infinite opacity logits (opacity exactly 0 or 1) and log scales of -inf (a flat axis) are usable.
    """
    return {
        "mean not finite": ~np.isfinite(means).all(axis=1),
        "quaternion not finite": ~np.isfinite(quats).all(axis=1),
        "quaternion zero": (quats == 0).all(axis=1),
        "scale not finite": np.isnan(log_scales).any(axis=1) | (log_scales > 80.0).any(axis=1),
        "opacity not a number": np.isnan(opacity_logits),
        "colour not finite": ~np.isfinite(sh).all(axis=(1, 2)),
    }
