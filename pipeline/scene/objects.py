"""Ground-truth objects of a scene: what question generators and metrics read, and the method never does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Relation = Literal["", "on", "in", "under", "behind"]


@dataclass(frozen=True, slots=True)
class SceneObject:
    """One object instance with its upright box."""

    instance: int
    """Instance id, as in `Semantics.instance`."""
    category: str
    """ScanNet200 name."""
    color: str
    """Basic colour name of its largest visible part; empty when no name fits."""
    center: tuple[float, float, float]
    """Box centre, metres."""
    half_extents: tuple[float, float, float]
    """Half sizes along the box's own x, y and up axes, metres."""
    yaw: float = 0.0
    """Rotation of the box about the up axis, radians."""
    room: str = ""
    """Room name, such as "kitchen"; empty when unknown."""
    states: tuple[str, ...] = ()
    """What holds of it: "open", "closed", "on", "off", ..."""
    parent: int = -1
    """Instance it stands in `relation` to, by construction; -1 for none."""
    relation: Relation = ""
    """How it stands to its parent."""
