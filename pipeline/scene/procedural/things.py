"""A thing before and after it is placed: its shape, its states, and the places where other things may stand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from pipeline.scene.objects import Relation, SceneObject
from pipeline.scene.procedural.shape import XYZ, Shape

Mount = Literal["base", "back", "top"]
Contact = Literal["rectangle", "ellipse", "none"]


@dataclass(frozen=True, slots=True)
class Slot:
    """Free space belonging to a thing, where smaller things may be put."""

    relation: Relation
    """How what is put there stands to the thing."""
    low: XYZ
    """Lowest corner in the thing's frame; its z is the supporting surface, metres."""
    high: XYZ
    """Highest corner; its z bounds the height of what fits, metres."""
    kind: str = ""
    """What belongs there when the thing knows, such as "seat" or "pillow"; fillers ask for slots by kind."""


@dataclass(frozen=True)
class Model:
    """A kind of thing with one look: what a builder returns."""

    category: str
    """ScanNet200 name."""
    color: str
    """Basic colour name of its main part."""
    shape: Shape
    """Surfaces in its own frame: z up from the floor it stands on, +y the front."""
    states: tuple[str, ...] = ()
    """What holds of it: "open", "closed", "on", "off"."""
    slots: tuple[Slot, ...] = ()
    """Where things may be put."""
    contact: Contact = "ellipse"
    """Outline of the face that touches its host and hides it; "none" for legs, rails and balls."""
    light: XYZ | None = None
    """Where it shines from; None for what gives no light."""

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner in its own frame, metres."""
        return self.shape.bounds()

    @cached_property
    def size(self) -> Float[np.ndarray, "3"]:
        """Width, depth and height, metres."""
        return self.bounds[1] - self.bounds[0]

    def slots_of(self, relation: Relation, kind: str = "") -> tuple[Slot, ...]:
        """Return the slots with this relation and kind."""
        return tuple(slot for slot in self.slots if slot.relation == relation and slot.kind == kind)


@dataclass(eq=False)
class Placed:
    """A thing in the apartment."""

    model: Model
    """What it is."""
    at: Float[np.ndarray, "3"]
    """World position of its frame's origin, metres."""
    yaw: float
    """Turn of its frame about z, radians."""
    room: int
    """Room it is in."""
    instance: int
    """Its place in the list of placed things."""
    parent: int = -1
    """Instance it stands in `relation` to; -1 for none."""
    relation: Relation = ""
    """How it stands to its parent."""
    host: int = -1
    """Instance whose surface it touches: the floor, a wall, a table; -1 for none."""
    mount: Mount = "base"
    """Which of its faces touches the host."""

    def to_world(self, point: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Return world coordinates of points in its frame."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.asarray(point) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + self.at

    @property
    def footprint(self) -> Float[np.ndarray, "4 2"]:
        """World corners of its box seen from above, in order around it, metres."""
        low, high = self.model.bounds
        corners = [(low[0], low[1], 0), (high[0], low[1], 0), (high[0], high[1], 0), (low[0], high[1], 0)]
        return self.to_world(np.array(corners))[:, :2]

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """World lowest and highest corner of an axis-aligned box around it, metres."""
        footprint, z = self.footprint, self.model.bounds[:, 2] + self.at[2]
        return np.stack([[*footprint.min(axis=0), z[0]], [*footprint.max(axis=0), z[1]]])

    def describe(self, room: str) -> SceneObject:
        """Return its ground-truth record."""
        low, high = self.model.bounds
        center = self.to_world((low + high) / 2)
        half = (high - low) / 2
        return SceneObject(
            instance=self.instance,
            category=self.model.category,
            color=self.model.color,
            center=(float(center[0]), float(center[1]), float(center[2])),
            half_extents=(float(half[0]), float(half[1]), float(half[2])),
            yaw=float(self.yaw),
            room=room,
            states=self.model.states,
            parent=self.parent,
            relation=self.relation,
        )


def oriented_boxes_overlap(a: Placed, b: Placed, margin: float = 0.0) -> bool:
    """Return whether two things' upright boxes come closer than `margin` metres (negative: overlap by more)."""
    za, zb = a.model.bounds[:, 2] + a.at[2], b.model.bounds[:, 2] + b.at[2]
    if za[0] >= zb[1] + margin or zb[0] >= za[1] + margin:
        return False
    fa, fb = a.footprint, b.footprint
    # Separating axis theorem: two rectangles are apart if they are along a side of either.
    for yaw in (a.yaw, b.yaw):
        for axis in ((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))):
            pa, pb = fa @ axis, fb @ axis
            if pa.min() >= pb.max() + margin or pb.min() >= pa.max() + margin:
                return False
    return True
