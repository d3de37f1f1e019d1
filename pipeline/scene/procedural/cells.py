"""How a length is cut into cells: even ones inside, finer ones at free ends, so that edges are sharp for few discs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

SIGMA = 0.75
"""Standard deviation of a disc in cell widths: wide enough that an even grid lets under 1 % through, no wider."""
HALF_OPACITY = 1.15 * SIGMA
"""Distance, in cell widths, at which a disc of opacity 0.97 is half transparent; free edges are put there."""
ENDS = (0.30, 0.55)
"""Widths of the last two cells at a free end relative to the inner ones: no inner disc reaches over the edge."""
_INSET = ENDS[0] * (HALF_OPACITY - 0.5)
"""Distance of the end cell from a free end."""
_END = _INSET + sum(ENDS)
"""Length taken by a free end, in inner cells."""
_MOST_EVEN = 3.2
"""Lengths under this many spacings are cut evenly: they have no room for finer ends."""


def line_counts(steps: Float[np.ndarray, "n"], joined: Bool[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Return the cells along lengths given in wanted spacings.

    Args:
        steps: Lengths.
        joined: Whether another surface continues at the low and the high end; else the end is free.
    """
    free = 2 - joined.sum(axis=1)
    even = np.maximum(1.0, np.ceil(steps + 0.4 - free * (HALF_OPACITY - 0.5)))
    graded = np.maximum(2 * free + 1, np.ceil(steps + free * (2 - _END)))
    return np.where(steps < _MOST_EVEN, even, graded)


def line_cells(
    count: Int[np.ndarray, "n"],
    index: Int[np.ndarray, "n"],
    shift: Float[np.ndarray, "n"],
    joined: Bool[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return the middle and the width of cells along a unit length.

    Args:
        count: Cells along the length.
        index: Which cell, from 0.
        shift: Shift of the middle, in widths of an inner cell; the finer cells at the ends do not move.
        joined: Whether another surface continues at the low and the high end.
    """
    low, high = 1 - joined[:, 0].astype(int), 1 - joined[:, 1].astype(int)
    inner = 1.0 / np.maximum(count - 2 * (low + high) + _END * (low + high), 0.5)
    from_low, from_high = np.where(low, index, 9), np.where(high, count - 1 - index, 9)
    from_end = np.minimum(from_low, from_high)
    at_end = inner * np.where(from_end == 0, _INSET + ENDS[0] / 2, _INSET + ENDS[0] + ENDS[1] / 2)
    middle = np.where(
        from_end > 1,
        inner * (_END * low + index - 2 * low + 0.5 + shift),
        np.where(from_low < from_high, at_end, 1.0 - at_end),
    )
    width = inner * np.where(from_end > 1, 1.0, np.where(from_end == 0, *ENDS))
    # Too few cells for finer ends: even ones, with the half opacity of the outer two on the free edges.
    margin_low, margin_high = (0.5 + (HALF_OPACITY - 0.5) * end for end in (low, high))
    even = 1.0 / (count - 1 + margin_low + margin_high)
    is_even = count < 2 * (low + high) + 1
    return np.where(is_even, even * (margin_low + index), middle), np.where(is_even, even, width)
