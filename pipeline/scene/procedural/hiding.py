"""Which surfaces placed things hide: floors under mats, walls behind pictures, table tops under books."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int32

from pipeline.scene.procedural.cutting import INSCRIBED, Faces, cut, without_hidden
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.things import Placed

THIN_M = 0.16
"""Things that stand out less than this from what they touch hide it; past thicker ones nothing shows."""
STRUCTURE = ("floor", "wall", "ceiling")


def visible_shapes(things: list[Placed]) -> list[Shape]:
    """Return every thing's surfaces without what its own parts or, on floors, walls and ceilings, other things hide."""
    covers: dict[int, list[tuple[int, int, np.ndarray, np.ndarray]]] = {}
    for thing in things:
        if _lies_flat(thing) and things[thing.host].model.category in STRUCTURE and _is_aligned(thing):
            covers.setdefault(thing.host, []).append(_cover(thing))
    shapes: dict[int, Shape] = {}
    for thing in things:
        if id(thing.model) not in shapes:
            shapes[id(thing.model)] = without_hidden(thing.model.shape)
    result = []
    for thing in things:
        own = shapes[id(thing.model)]
        # Structure has its own frame at the world's origin, so world covers apply as they are.
        result.append(cut(own, _faces(covers[thing.instance])) if thing.instance in covers else own)
    return result


def hidden_discs(
    means: Float[np.ndarray, "M 3"], owner: Int32[np.ndarray, "M"], things: list[Placed]
) -> Bool[np.ndarray, "M"]:
    """Return which discs lie right under a flat thing or an open container, where turned things cannot be cut out."""
    hidden = np.zeros(len(means), bool)
    starts = np.searchsorted(owner, np.arange(len(things) + 1))
    for thing in things:
        if thing.host >= 0 and (_lies_flat(thing) or thing.model.contact == "rectangle"):
            rows = slice(starts[thing.host], starts[thing.host + 1])
            hidden[rows] |= _under(means[rows], thing)
    return hidden


def _lies_flat(thing: Placed) -> bool:
    across = 1 if thing.mount == "back" else 2
    return bool(thing.host >= 0 and thing.model.contact != "none" and thing.model.size[across] < THIN_M)


def _is_aligned(thing: Placed) -> bool:
    quarter = thing.yaw / (np.pi / 2)
    return abs(quarter - round(quarter)) < 1e-3


def _contact_axis(thing: Placed) -> tuple[int, float]:
    """Axis across the face that touches the host, in the thing's frame, and where that face lies."""
    low, high = thing.model.bounds
    return {"base": (2, float(low[2])), "back": (1, float(low[1])), "top": (2, float(high[2]))}[thing.mount]


def _faces(covers: list[tuple[int, int, np.ndarray, np.ndarray]]) -> Faces:
    axis, sign, low, high = zip(*covers, strict=True)
    return Faces(np.arange(len(covers)), np.array(axis), np.array(sign), np.stack(low), np.stack(high))


def _cover(thing: Placed) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Axis, sign and world corners of the face a thing turns to the room."""
    low, high = thing.model.bounds
    axis, face = _contact_axis(thing)
    middle, half = (low + high) / 2, (high - low) / 2
    if thing.model.contact == "ellipse":
        half = half * INSCRIBED
    middle[axis], half[axis] = face, 0.0
    # 1.5 cm before the host's plane: in front of baseboards, too.
    middle[axis] += -0.015 if thing.mount == "top" else 0.015
    corners = thing.to_world(np.stack([middle - half, middle + half]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    across = int((high - low).argmin())
    outward = np.zeros(3)
    outward[axis] = -1.0 if thing.mount == "top" else 1.0
    direction = thing.to_world(outward) - thing.at
    return across, 1 if direction[across] > 0 else -1, low, high


def _under(points: Float[np.ndarray, "n 3"], thing: Placed) -> Bool[np.ndarray, "n"]:
    low, high = thing.model.bounds
    c, s = np.float32(np.cos(thing.yaw)), np.float32(np.sin(thing.yaw))
    delta = points - thing.at.astype(np.float32)
    local = np.stack([c * delta[:, 0] + s * delta[:, 1], -s * delta[:, 0] + c * delta[:, 1], delta[:, 2]], axis=1)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-6)
    axis, face = _contact_axis(thing)
    across = [k for k in range(3) if k != axis]
    spread = np.abs(local[:, across] - middle[across]) / half[across]
    inside = (spread < 0.94).all(axis=1) if thing.model.contact == "rectangle" else (spread**2).sum(axis=1) < 0.6
    # Walls carry baseboards 1 cm thick; the underside of a board is 2.2 cm below what stands on it.
    reach = 0.025 if thing.mount == "back" else 0.012
    return inside & (np.abs(local[:, axis] - face) < reach)
