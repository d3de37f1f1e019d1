"""Which recorded views are used at all: every n-th, or those farthest apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.geometry import Camera


def spread_views(cameras: Sequence[Camera], every_nth: int = 1, most: int | None = None) -> tuple[int, ...]:
    """Return the numbers of the views used, ascending.

    Farthest-point order: the first view, then again and again the one whose nearest taken view is farthest. Two poses
    are as far apart as their centres are in metres plus their viewing directions in radians; ties go to the lower
    number.

    Args:
        cameras: The N recorded cameras.
        every_nth: Of these, every n-th is looked at.
        most: Most views taken; None for all that are looked at.
    """
    views = range(0, len(cameras), every_nth)
    if most is None or len(views) <= most:
        return tuple(views)
    centers = np.array([cameras[view].center for view in views])
    directions = np.array([cameras[view].forward for view in views])
    taken, nearest = [0], np.full(len(views), np.inf)
    while len(taken) < most:
        angles = np.arccos(np.clip(directions @ directions[taken[-1]], -1.0, 1.0))
        nearest = np.minimum(nearest, np.linalg.norm(centers - centers[taken[-1]], axis=1) + angles)
        nearest[taken] = -1.0  # poses that occur twice are not taken twice
        taken.append(int(nearest.argmax()))
    return tuple(sorted(views[k] for k in taken))
