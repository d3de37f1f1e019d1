"""What the outline and the depth of one thing tell of its state: a door's free edge, the hollow of an open case."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from pipeline.models.symbolic.components import JUMP_M, JUMP_PER_M

DENT_M = 0.08
"""Surface this far behind the line across a thing is a look inside it; panels and handles stand out less."""
DENT_PER_M = 0.03
"""Added per metre of depth, which is less certain farther off."""
RIM = 4
"""Pixels at each end of a line over which depth may blend with what is beside the thing."""
EDGE_SHARE = 0.15
"""Share of an outline that must be seen against something at the same depth or farther to be judged."""


def free_edges(mask: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"]) -> tuple[float, ...]:
    """Return the share of each upright edge behind which there is nothing near; edges that are not seen are left out.

    A leaf in its frame has the frame or the wall next to both edges; a leaf that stands open has air beside one.

    Args:
        mask: Pixels of the leaf, with at least one pixel of margin where the image goes on.
        depth_m: z-depth of the same pixels, metres.
    """
    from pipeline.models.symbolic.outline_kernels import free_edge

    shares = []
    for inward in (1, -1):
        free, seen, rows = free_edge(mask, depth_m, inward, np.float32(JUMP_M), np.float32(JUMP_PER_M))
        if seen >= EDGE_SHARE * rows:
            shares.append(free / seen)
    return tuple(shares)


def hollow(mask: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"]) -> float:
    """Return the share of a thing's pixels that lie behind the straight line across it, along its row or its column.

    Seen from outside, a closed case is about convex: along any line of the image its inverse depth never falls below
    the line between its ends. Where it does, one looks into it.

    Args:
        mask: Pixels of the thing.
        depth_m: z-depth, metres.
    """
    from pipeline.models.symbolic.outline_kernels import hollow_rows

    limits = (RIM, DENT_M, DENT_PER_M)
    return max(hollow_rows(mask, depth_m, *limits), hollow_rows(mask.T, depth_m.T, *limits))
