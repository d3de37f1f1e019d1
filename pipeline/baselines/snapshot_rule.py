"""3D-Mem's rule: few frames that together hold every object, found by splitting the objects by place.

All objects are one group. The largest group that has no frame yet is taken; a frame that holds all its objects becomes
its snapshot, else the group is split by 2-means and both halves wait. Of several frames the one holding most objects,
of the group or not, is best, then the one most sure of the group's; a frame that is a snapshot already goes before
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64

ROUNDS = 100
"""Most rounds of 2-means; with few points it settles after a handful."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A frame and the objects it stands for."""

    frame: int
    """Number of the frame."""
    objects: tuple[int, ...]
    """Objects that were given to it, ascending."""


def choose_snapshots(
    places: Float[np.ndarray, "n 2"], held: Bool[np.ndarray, "n F"], confidence: Float[np.ndarray, "n F"]
) -> list[Snapshot]:
    """Return the snapshots of a scene, by frame; objects that no frame holds are in none.

    Args:
        places: Level centres of the objects, metres.
        held: Whether a frame holds an object.
        confidence: How sure a frame is of an object.
    """
    objects_held = held.sum(axis=0)
    groups = [np.flatnonzero(held.any(axis=1))]
    chosen: dict[int, list[int]] = {}
    while groups:
        largest = max(range(len(groups)), key=lambda i: (len(groups[i]), -i))
        group = groups.pop(largest)
        if not len(group):
            continue
        frames = np.flatnonzero(held[group].all(axis=0)).tolist()
        if not frames:
            groups += split_in_two(places, group)
            continue
        ranked = sorted(frames, key=lambda f: (-objects_held[f], -confidence[group, f].sum(), f))
        frame = next((frame for frame in ranked if frame in chosen), ranked[0])
        chosen.setdefault(frame, []).extend(group.tolist())
    return [Snapshot(frame, tuple(sorted(objects))) for frame, objects in sorted(chosen.items())]


def split_in_two(places: Float[np.ndarray, "n 2"], group: Int64[np.ndarray, "k"]) -> list[Int64[np.ndarray, "_"]]:
    """Return the two halves of a group of at least two objects by 2-means, neither empty.

    It starts from the two objects farthest apart, so that no random state is needed; objects at one place are halved in
    their order.

    Args:
        places: Centres of all objects.
        group: Which of them are split.
    """
    points = places[group]
    apart = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    first, second = np.unravel_index(int(apart.argmax()), apart.shape)
    centres = points[[first, second]]
    if apart[first, second] == 0:
        return [group[: len(group) // 2], group[len(group) // 2 :]]
    nearer = np.zeros(len(group), bool)
    for _ in range(ROUNDS):
        distances = ((points[:, None] - centres[None]) ** 2).sum(axis=2)
        before, nearer = nearer, distances[:, 1] < distances[:, 0]
        if (nearer == before).all():
            break
        # A mean lies among its own points, so neither side ever becomes empty.
        centres = np.stack([points[~nearer].mean(axis=0), points[nearer].mean(axis=0)])
    return [group[~nearer], group[nearer]]
