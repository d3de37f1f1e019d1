"""Which parts of a view are one object: those that something nearer cuts apart, and those that stand on one spot.

Two parts of one name are one thing when one lies above the other in one upright thing, when the middle of one lies
within the box of the other (specks of a thing that another is drawn over, folds of a curtain), or when something cuts
them apart: one walks from one part to the other where they are closest and asks what lies between. A thing before them
or on them cuts them apart; the wall or floor beyond is seen between two things.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int64

from pipeline.models.symbolic.components import JUMP_M, JUMP_PER_M, Parts

HIDDEN_GAP_M = 0.4
"""Widest gap bridged behind an occluder: a chair before a bed hides about this much of it."""
UPRIGHT_GAP_M = 0.45
"""Tallest gap bridged within one upright thing, such as the pole between a lamp's shade and foot."""
UPRIGHT_OVERLAP = 0.5
"""Share of the narrower part's width that must lie over the other for them to be one upright thing."""
STANDS_OUT_M = 0.15
"""How far one part of an upright thing may stand out before the other, as a lamp's shade does."""
WITHIN_M = 0.08
"""A part whose middle lies this close to the box of another of the same name belongs to it."""
OCCLUDED_SHARE = 0.5
"""Share of the pixels between two parts that must lie before them or on them."""
NEAREST = 48
"""Pixels of each part tried for where two parts are closest."""
PROBES = 16
"""Pixels looked at between two parts."""
_RULES = (
    *(HIDDEN_GAP_M, UPRIGHT_GAP_M, UPRIGHT_OVERLAP, STANDS_OUT_M, WITHIN_M),
    *(OCCLUDED_SHARE, NEAREST, PROBES, JUMP_M, JUMP_PER_M),
)


def merge_parts(
    parts: Parts,
    depth_m: Float[np.ndarray, "H W"],
    low: Float[np.ndarray, "P 3"],
    high: Float[np.ndarray, "P 3"],
    mergeable: Bool[np.ndarray, "P"],
) -> Int64[np.ndarray, "P"]:
    """Return the object of each part: the index of its largest part.

    Args:
        parts: Parts of a view, largest first.
        depth_m: z-depth of the view, metres.
        low: Lower corner of each part's box in gravity-aligned axes (right, up, forward), metres.
        high: Upper corner.
        mergeable: Parts that may be an object with others; false for walls and the like, which are everywhere.
    """
    from pipeline.models.symbolic.merge_kernels import merge

    owner: Int64[np.ndarray, "P"] = merge(
        parts.category, parts.labels, parts.sample_pixel, parts.sample_begin, depth_m, low, high, mergeable, _RULES
    )
    return owner
