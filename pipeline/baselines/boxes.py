"""Objects as upright boxes in text: where they lie, how large they are, what they stand on and next to.

Boxes have their third axis along gravity; the other two are the world's where it points along one of its axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pipeline.scene.scene import Scene

TRIM = 2.0
"""Percent of the centres dropped at each end of an extent: few Gaussians lie far off their object."""
REST_M = 0.15
"""An object rests on another whose top is at most this far from its foot."""
BESIDE_M = 0.6
"""Objects with at most this gap are next to each other: an arm's length."""
MOST_BESIDE = 2
"""Neighbours named at most."""


@dataclass(frozen=True, slots=True)
class ObjectBox:
    """One object."""

    name: str
    """Category."""
    ids: Int[np.ndarray, "n"]
    """Its Gaussians."""
    low: Float[np.ndarray, "3"]
    """Lower corner: two level axes, then height, metres."""
    high: Float[np.ndarray, "3"]
    """Upper corner."""

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the box."""
        return 0.5 * (self.low + self.high)

    @property
    def size(self) -> Float[np.ndarray, "3"]:
        """Sides of the box, metres."""
        return self.high - self.low


def level_axes(scene: Scene) -> Float[np.ndarray, "3 3"]:
    """Return a rotation from the world to axes whose third is up, rows being those axes."""
    up = np.asarray(scene.up, np.float64)
    first = np.eye(3)[(int(np.abs(up).argmax()) + 1) % 3]
    first = first - (first @ up) * up
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def object_box(scene: Scene, name: str, ids: Int[np.ndarray, "n"]) -> ObjectBox:
    """Return the box of an object's Gaussians, at least one."""
    points = scene.gaussians.means[ids].astype(np.float64) @ level_axes(scene).T
    low, high = np.percentile(points, [TRIM, 100.0 - TRIM], axis=0)
    return ObjectBox(name, ids, low, high)


def place_notes(boxes: Sequence[ObjectBox]) -> list[str]:
    """Return for every object what it stands on and next to, its place and its size, in words."""
    return [" ".join([*_relations(boxes, number), _measures(box)]) for number, box in enumerate(boxes)]


def _relations(boxes: Sequence[ObjectBox], number: int) -> list[str]:
    box, others = boxes[number], [other for other in range(len(boxes)) if other != number]
    under = [other for other in others if _rests_on(box, boxes[other])]
    said = [("on", other) for other in sorted(under, key=lambda i: float(np.prod(boxes[i].size[:2])))[:1]]
    gaps = {other: _gap(box, boxes[other]) for other in others if other not in under}
    beside = sorted((gap, other) for other, gap in gaps.items() if gap <= BESIDE_M)[:MOST_BESIDE]
    said += [("next to", other) for _, other in beside]
    return [f"It is {relation} the {boxes[other].name} (object {other})." for relation, other in said]


def _rests_on(upper: ObjectBox, lower: ObjectBox) -> bool:
    centre = upper.centre[:2]
    over = bool((centre >= lower.low[:2]).all() and (centre <= lower.high[:2]).all())
    return over and abs(float(upper.low[2] - lower.high[2])) <= REST_M


def _gap(a: ObjectBox, b: ObjectBox) -> float:
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(a.low - b.high, b.low - a.high))))


def _measures(box: ObjectBox) -> str:
    centre, size = (", ".join(f"{value:.1f}" for value in values) for values in (box.centre, box.size))
    return f"Place {centre} m, size {size} m."
