"""What a render returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32


@dataclass(frozen=True, slots=True)
class Rendering:
    """Images of one view; an output that was not asked for is None."""

    color: Float32[np.ndarray, "H W 3"] | None = None
    """Linear sum of w_j c_j plus the background behind it; at least 0, no upper clamp."""
    depth: Float32[np.ndarray, "H W"] | None = None
    """Expected z-depth sum(w z) / sum(w), metres; 0 where alpha is 0."""
    alpha: Float32[np.ndarray, "H W"] | None = None
    """Accumulated opacity 1 - T, 0 to 1."""
    dominant: Int32[np.ndarray, "H W"] | None = None
    """Index of the Gaussian with the largest weight T * alpha; -1 where nothing contributes. Ties: nearest first."""
    dominant_weight: Float32[np.ndarray, "H W"] | None = None
    """That weight, 0 to 1; 0 where `dominant` is -1."""
