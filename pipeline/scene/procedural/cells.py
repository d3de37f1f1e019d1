"""How a length is cut into cells: even ones inside, a thin one at both ends, so that edges are sharp for few discs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

SIGMA = 0.75
"""Standard deviation of a disc in cell widths: wide enough that an even grid lets under 1 % through, no wider."""
HALF_OPACITY = 1.15 * SIGMA
"""Distance, in cell widths, at which a disc of opacity 0.97 is half transparent; edges are put there."""
ENDS = (0.30, 0.55)
"""Widths of the last two cells at either end relative to the inner ones: no inner disc reaches over the edge."""
_INSET = ENDS[0] * (HALF_OPACITY - 0.5)
"""Distance of the end cells from the ends."""
_END = _INSET + sum(ENDS)
"""Length taken by an end, in inner cells."""
_MOST_EVEN = 3.2
"""Lengths under this many spacings are cut evenly: they have no room for finer ends."""


def line_counts(steps: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Return the cells along lengths given in wanted spacings."""
    even = np.maximum(1.0, np.ceil(steps + 0.6 - 2 * (HALF_OPACITY - 0.5)))
    return np.where(steps < _MOST_EVEN, even, np.maximum(5.0, np.ceil(steps + 4 - 2 * _END)))


def line_cells(
    count: Int[np.ndarray, "n"], index: Int[np.ndarray, "n"], shift: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return the middle and the width of cells along a unit length.

    Args:
        count: Cells along the length.
        index: Which cell, from 0.
        shift: Shift of the middle, in widths of an inner cell; cells at the ends do not move.
    """
    inner = 1.0 / (count - 4 + 2 * _END)
    from_end = np.minimum(index, count - 1 - index)
    middle = inner * (_END + index - 1.5 + shift)
    end = inner * np.where(from_end == 0, _INSET + ENDS[0] / 2, _INSET + ENDS[0] + ENDS[1] / 2)
    middle = np.where(from_end > 1, middle, np.where(index == from_end, end, 1.0 - end))
    width = inner * np.where(from_end > 1, 1.0, np.where(from_end == 0, *ENDS))
    even = 1.0 / (count - 1 + 2 * HALF_OPACITY)
    is_even = count < 5
    return np.where(is_even, even * (HALF_OPACITY + index), middle), np.where(is_even, even, width)
