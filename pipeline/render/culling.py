"""Which blocks of a prepared scene a window of an image may show."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32

from pipeline.render.cull_kernels import cull
from pipeline.render.lens import Lens
from pipeline.render.prepare import PreparedGaussians
from pipeline.render.window import Window

WIDEST_BOUND = 3.34
"""Just over sqrt(2 ln 255): standard deviations at which a Gaussian of opacity 1 falls to alpha 1/255."""
LOW_PASS_PX = 0.55
"""Just over sqrt(0.3): what the low-pass adds to a projected deviation, at most."""


def visible_blocks(prepared: PreparedGaussians, lens: Lens, window: Window, near: float) -> Int32[np.ndarray, "b"]:
    """Return the blocks that may hold a Gaussian the window shows, ascending; never leaves one out.

    A Gaussian reaches the left edge e only if fx X + (cx - e) Z + k (s fx sqrt(1 + l^2) + Z sqrt(.3)) >= 0, with s its
    largest deviation, l the clamp limit and k the widest bound. That is a plane in camera space shifted by the block's
    reach; likewise for the other three sides.
    """
    spread = WIDEST_BOUND * LOW_PASS_PX
    (fx, fy), (cx, cy) = lens.focal, lens.principal
    reach_x = WIDEST_BOUND * fx * np.hypot(1.0, max(map(abs, lens.x_limits)))
    reach_y = WIDEST_BOUND * fy * np.hypot(1.0, max(map(abs, lens.y_limits)))
    local = np.array(
        [
            [0.0, 0.0, 1.0],
            [fx, 0.0, cx - window.left + spread],
            [-fx, 0.0, window.right - cx + spread],
            [0.0, fy, cy - window.top + spread],
            [0.0, -fy, window.bottom - cy + spread],
        ]
    )
    normals = local @ lens.rotation
    offsets = -normals @ lens.center - np.array([near, 0.0, 0.0, 0.0, 0.0])
    sides = np.column_stack([normals, offsets, [0.0, reach_x, reach_x, reach_y, reach_y]])
    kept = np.empty(len(prepared.block_reach), np.int32)
    return kept[: cull(prepared.block_centers, prepared.block_halves, prepared.block_reach, sides, kept)]
