# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Lines of sight through a grid of cells. Serial; no flag changes a result.

Every ray is walked in equal steps of less than a cell and stops at the first blocked one. What lies outside the grid
is open.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.cached_kernels import kernel

STEP = 0.7
"""Step along a ray, in cells: a corner that is cut by less than a third of a cell may be missed."""


@kernel
def sight_lines(
    blocked,  # (I, J, K) bool
    origin,  # (3,) float64, corner of cell (0, 0, 0), metres
    cell_m,  # side of a cell, metres
    eyes,  # (E, 3) float64, metres
    points,  # (P, 3) float64, metres
    margin_m,  # last part of a ray, which is not looked at: it lies in the point's own surface
):
    """Return (E, P) bool: True where nothing is in the way between an eye and a point."""
    clear = np.ones((len(eyes), len(points)), np.bool_)
    for e in range(len(eyes)):
        for p in range(len(points)):
            dx = points[p, 0] - eyes[e, 0]
            dy = points[p, 1] - eyes[e, 1]
            dz = points[p, 2] - eyes[e, 2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            for s in range(1, int((length - margin_m) / (STEP * cell_m)) + 1):
                share = s * STEP * cell_m / length
                i = math.floor((eyes[e, 0] + share * dx - origin[0]) / cell_m)
                j = math.floor((eyes[e, 1] + share * dy - origin[1]) / cell_m)
                k = math.floor((eyes[e, 2] + share * dz - origin[2]) / cell_m)
                inside = 0 <= i < blocked.shape[0] and 0 <= j < blocked.shape[1] and 0 <= k < blocked.shape[2]
                if inside and blocked[i, j, k]:
                    clear[e, p] = False
                    break
    return clear
