"""Connected parts of a category image, cut where depth jumps.

Rows are first cut into runs of one category at one surface; runs that touch in neighbouring rows join. A part is a
patch of one category on one surface: an object that something stands before may show several (see `merge.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Int32, Int64

JUMP_M = 0.06
"""Depth step between neighbouring pixels that separates two surfaces: about the thickness of a chair back."""
JUMP_PER_M = 0.02
"""Added per metre of depth: depth is less certain farther off."""
BEND = 0.012
"""Largest bend, as a share of inverse depth, of what counts as one plane: a table top seen at a low angle falls away
by more than a jump from pixel to pixel, but the inverse depth of a plane is straight."""
SAMPLES = 192
"""Pixels sampled per part for positions and colours: percentiles of a part are then good to about 2 %."""


@dataclass(frozen=True, slots=True)
class Parts:
    """P parts, largest first."""

    run_begin: Int32[np.ndarray, "R1"]
    """First pixel of each run of pixels in a row, in reading order; one more for the end."""
    row_begin: Int32[np.ndarray, "H1"]
    """First run of each row; one more for the end."""
    run_part: Int32[np.ndarray, "R"]
    """Part of each run, -1 for none."""
    labels: Int32[np.ndarray, "H W"]
    """Part per pixel, -1 where there is none or one too small to count."""
    category: Int64[np.ndarray, "P"]
    """Category id of each."""
    pixels: Int64[np.ndarray, "P"]
    """Area of each."""
    bounds: Int64[np.ndarray, "P 4"]
    """First and last column and row of each: left, top, right, bottom."""
    sample_pixel: Int64[np.ndarray, "S"]
    """Flat indices of sampled pixels, part by part, spread evenly over each."""
    sample_begin: Int64[np.ndarray, "P1"]
    """Where the samples of each part begin; one more for the end."""


def find_parts(
    category: Int[np.ndarray, "H W"], depth_m: Float[np.ndarray, "H W"], min_pixels: int, names: int
) -> Parts:
    """Return the parts of a view.

    Neighbours lie on one surface when their depths are close, or when they are part of four pixels in a row on one
    plane. Four, since two surfaces blend over a pixel or two at an edge, and three such pixels may look straight.

    Args:
        category: Category id per pixel, below 0 where there is none.
        depth_m: z-depth, metres; pixels at 0 belong to no part.
        min_pixels: Smaller parts are left out.
        names: Category ids from here on are none.
    """
    from pipeline.models.symbolic.parts_kernels import find_runs, number_parts

    category = np.ascontiguousarray(category, np.int32)
    depth = np.ascontiguousarray(depth_m, np.float32)
    limits = (np.float32(value) for value in (JUMP_M, JUMP_PER_M, BEND))
    run_begin, root, row_begin = find_runs(category, depth, names, *limits)
    return Parts(run_begin, row_begin, *number_parts(run_begin, root, category, min_pixels, SAMPLES))


def jump_limit(depth_m: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return the depth step (metres) above which neighbours at this depth lie on different surfaces."""
    return np.asarray(JUMP_M + JUMP_PER_M * depth_m)
