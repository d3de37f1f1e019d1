"""What rests on or under what in a scan, from the points themselves: boxes of real furniture are too coarse for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from pipeline.scene.objects import Relation, SceneObject

REACH_M = 0.06
"""Horizontal distance within which two surface points are one above the other: above a scan's vertex spacing."""
CONTACT_M = 0.10
"""Height above a surface up to which a thing rests on it; scans blur the seam."""
STANDING_M = 0.2
"""Bottoms lower than this over the floor stand on the floor."""
_CARRIED = 0.35
"""Share of a thing's lowest points on a surface from which it rests there: scans see little of an underside."""
_COVERED = 0.7
"""Share of a thing's points beneath another from which it is under it."""
_OVER = 0.6
"""Share of a thing's points within its support's outline: more than merely touching its side."""
_STRUCTURE = frozenset({"wall", "floor", "ceiling"})
_HANGING = frozenset({"window", "door", "doorframe", "curtain", "picture", "poster", "mirror", "clock", "blinds"})
"""Things that touch furniture without resting on it."""


def state_support(
    objects: Sequence[SceneObject], points: dict[int, Float[np.ndarray, "k 3"]], floor_z: float
) -> tuple[SceneObject, ...]:
    """Return the objects with `parent` and `relation` set where one plainly rests on, or stands under, another.

    Args:
        objects: Objects of a scan.
        points: Surface points of each instance, metres, z up.
        floor_z: Height of the floor, metres.
    """
    return tuple(_placed(o, objects, points, floor_z) for o in objects)


def _placed(
    o: SceneObject, objects: Sequence[SceneObject], points: dict[int, Float[np.ndarray, "k 3"]], floor_z: float
) -> SceneObject:
    if o.category in _STRUCTURE | _HANGING:
        return o
    own = points[o.instance]
    bottom = float(np.percentile(own[:, 2], 2))
    soles = own[own[:, 2] < bottom + 0.06]
    standing = bottom <= floor_z + STANDING_M
    relation: Relation = "under" if standing else "on"
    scores = []
    for other in objects:
        if other.instance == o.instance or other.category in _STRUCTURE | _HANGING or _volume(o) > 0.8 * _volume(other):
            continue
        if _share_over(own, other) < _OVER:
            continue
        if standing:
            score = _share_near(own, points[other.instance], -3.0, -0.02)
        else:
            score = _share_near(soles, points[other.instance], -REACH_M, CONTACT_M)
        scores.append((score, other.instance))
    scores.sort(reverse=True)
    second = scores[1][0] if len(scores) > 1 else 0.0
    if not scores or scores[0][0] < (_COVERED if standing else _CARRIED) or second > scores[0][0] / 2:
        return o
    return replace(o, parent=scores[0][1], relation=relation)


def _share_near(
    points: Float[np.ndarray, "k 3"], surface: Float[np.ndarray, "p 3"], low_m: float, high_m: float
) -> float:
    """Return the share of points with a surface point close by on the floor plan and `low` to `high` below them."""
    from scipy.spatial import cKDTree

    tree = cKDTree(surface[:, :2])
    hits = 0
    for point, near in zip(points, tree.query_ball_point(points[:, :2], REACH_M), strict=True):
        over = point[2] - surface[near, 2]
        hits += bool(((over >= low_m) & (over <= high_m)).any())
    return hits / max(1, len(points))


def _share_over(points: Float[np.ndarray, "k 3"], support: SceneObject) -> float:
    """Return the share of points above or below an object's footprint, with a hand's breadth around it."""
    cos, sin = np.cos(support.yaw), np.sin(support.yaw)
    local = (points[:, :2] - support.center[:2]) @ np.array([[cos, -sin], [sin, cos]])
    return float((np.abs(local) <= np.array(support.half_extents[:2]) + REACH_M).all(axis=1).mean())


def _volume(o: SceneObject) -> float:
    return 8.0 * float(np.prod(o.half_extents))
