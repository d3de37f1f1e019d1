"""Surfaces of one object in its own frame: quads, cones (tubes), discs and balls, and the solids built of them.

An object's frame stands on the floor: z up, +y its front, origin at the middle of its footprint. Sampling
into Gaussians is `sampling.py`'s work.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from pipeline.scene.procedural.paint import Paint

Number = float | int
"""Builders write 0 for 0.0; checked types tell the two apart."""
XYZ = tuple[Number, Number, Number]
Joins = tuple[bool, bool, bool, bool]
"""Whether a surface goes on beyond its low u, high u, low v and high v end."""
FREE: Joins = (False, False, False, False)
"""A surface that stands alone: all its ends are edges."""


class Kind(IntEnum):
    """How a surface maps its four frame rows to points."""

    QUAD = 0
    """Rows are corners P00, P10, P01, P11; the normal is (P10 - P00) x (P01 - P00)."""
    CONE = 1
    """Rows are base centre, two radial half axes, axis; radii scale the half axes at both ends."""
    DISC = 2
    """Rows are centre, two radial half axes, unit normal."""
    BALL = 3
    """Rows are centre and three half axes."""


# Corner i of a block is (x bit 0, y bit 1, z bit 2); each row lists P00, P10, P01, P11 with the normal outward.
_FACES = {
    "bottom": (0, 2, 1, 3),
    "top": (4, 5, 6, 7),
    "back": (0, 1, 4, 5),
    "front": (3, 2, 7, 6),
    "left": (2, 0, 6, 4),
    "right": (1, 3, 5, 7),
}


def _unit_corners() -> Float[np.ndarray, "8 3"]:
    bits = np.arange(8)
    return np.stack([(bits & 1) - 0.5, (bits >> 1 & 1) - 0.5, (bits >> 2 & 1) * 1.0], axis=1)


_CORNERS = _unit_corners()


@dataclass(slots=True)
class Shape:
    """A growing list of surfaces; builders fill it, nothing changes it afterwards."""

    kinds: list[int] = field(default_factory=list)
    """`Kind` of each surface."""
    frames: list[Float[np.ndarray, "4 3"]] = field(default_factory=list)
    """Frame rows of each surface, metres."""
    tapers: list[tuple[float, float]] = field(default_factory=list)
    """Radius factors at base and tip (cones), or inner and outer radius factors (discs)."""
    paints: list[Paint] = field(default_factory=list)
    """Finish of each surface."""
    joins: list[Joins] = field(default_factory=list)
    """Which ends of each surface's grid another surface continues."""
    details: list[float] = field(default_factory=list)
    """Spacing of each surface's samples relative to what its object's size asks for."""

    def quad(self, corners: Float[np.ndarray, "4 3"], paint: Paint) -> None:
        """Add a flat four-sided surface from corners P00, P10, P01, P11."""
        self.add(Kind.QUAD, np.asarray(corners, np.float64), paint)

    def block(
        self, at: XYZ, size: XYZ, paint: Paint, *, skip: tuple[str, ...] = (), top: tuple[float, float] = (1.0, 1.0)
    ) -> None:
        """Add a box standing on the middle of its bottom face.

        Args:
            at: Middle of the bottom face, metres.
            size: Width (x), depth (y) and height (z), metres.
            paint: Finish.
            skip: Faces left out: bottom, top, back (-y), front (+y), left (-x), right (+x).
            top: Width and depth of the top face relative to the bottom's, for tapered boxes.
        """
        corners = _CORNERS * size
        corners[4:, :2] *= top
        corners += at
        for name, index in _FACES.items():
            if name not in skip:
                self.add(Kind.QUAD, corners[list(index)], paint)

    def tube(
        self, at: XYZ, radius: float, height: float, paint: Paint, *, tip: float = 1.0, caps: str = "both"
    ) -> None:
        """Add an upright cylinder or truncated cone.

        Args:
            at: Middle of the base, metres.
            radius: Base radius, metres.
            height: Height, metres.
            paint: Finish.
            tip: Top radius relative to the base's.
            caps: Which discs close it: both, top, bottom or none.
        """
        self.rod(at, (0.0, 0.0, height), radius, paint, tip=tip, caps=caps)

    def rod(self, at: XYZ, along: XYZ, radius: float, paint: Paint, *, tip: float = 1.0, caps: str = "both") -> None:
        """Add a cylinder or truncated cone from `at` to `at + along`."""
        axis = np.array(along, np.float64)
        unit = axis / np.linalg.norm(axis)
        u = np.cross(unit, np.eye(3)[np.abs(unit).argmin()])
        u /= np.linalg.norm(u)
        w = np.cross(unit, u)
        base = np.array(at, np.float64)
        self.add(Kind.CONE, np.stack([base, u * radius, w * radius, axis]), paint, (1.0, tip))
        if caps in ("both", "bottom"):
            self.add(Kind.DISC, np.stack([base, w * radius, u * radius, -unit]), paint, (0.0, 1.0))
        if caps in ("both", "top"):
            frame = np.stack([base + axis, u * radius * tip, w * radius * tip, unit])
            self.add(Kind.DISC, frame, paint, (0.0, 1.0))

    def ring(self, at: XYZ, along: XYZ, inner: float, outer: float, paint: Paint) -> None:
        """Add a flat ring about `at`, facing the way of `along`; inner and outer radius in metres."""
        unit = np.array(along, np.float64) / np.linalg.norm(along)
        u = np.cross(unit, np.eye(3)[np.abs(unit).argmin()])
        u *= outer / np.linalg.norm(u)
        frame = np.stack([np.array(at, np.float64), u, np.cross(unit, u), unit])
        self.add(Kind.DISC, frame, paint, (inner / outer, 1.0))

    def ball(self, at: XYZ, radii: Number | XYZ, paint: Paint) -> None:
        """Add an ellipsoid about its middle `at`."""
        axes = np.diag(np.broadcast_to(np.asarray(radii, np.float64), (3,)))
        self.add(Kind.BALL, np.concatenate([np.array([at], np.float64), axes]), paint)

    def board(self, at: XYZ, size: XYZ, paint: Paint, *, skip: tuple[str, ...] = ()) -> None:
        """Add a thin box, with all six faces unless some are skipped."""
        self.block(at, size, paint, skip=skip)

    def hollow(self, at: XYZ, size: XYZ, thickness: float, paint: Paint, *, open_side: str = "top") -> None:
        """Add an open box of boards: everything but the open side (top or front) is closed."""
        (x, y, z), (w, d, h), t = at, size, thickness
        self.board((x, y, z), (w, d, t), paint)
        side = ("bottom",) if open_side == "top" else ("bottom", "back")
        self.board((x - w / 2 + t / 2, y, z + t), (t, d, h - t), paint, skip=side)
        self.board((x + w / 2 - t / 2, y, z + t), (t, d, h - t), paint, skip=side)
        self.board((x, y - d / 2 + t / 2, z + t), (w - 2 * t, t, h - t), paint, skip=("bottom", "left", "right"))
        if open_side == "top":
            self.board((x, y + d / 2 - t / 2, z + t), (w - 2 * t, t, h - t), paint, skip=("bottom", "left", "right"))
        else:
            self.board((x, y + t / 2, z + h - t), (w - 2 * t, d - t, t), paint, skip=("left", "right", "back"))

    def legs(self, width: float, depth: float, height: float, thickness: float, paint: Paint) -> None:
        """Add four square legs whose outer faces stand on a width x depth rectangle."""
        for sx in (-0.5, 0.5):
            for sy in (-0.5, 0.5):
                at = (sx * (width - thickness), sy * (depth - thickness), 0.0)
                self.block(at, (thickness, thickness, height), paint, skip=("top", "bottom"))

    def merge(self, other: Shape, *, at: XYZ = (0.0, 0.0, 0.0), yaw: float = 0.0, tilt: float = 0.0) -> None:
        """Add another shape turned by `tilt` about its x axis, then `yaw` about z, then moved to `at` (radians, m)."""
        ct, st, cy, sy = np.cos(tilt), np.sin(tilt), np.cos(yaw), np.sin(yaw)
        turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
        columns = (other.kinds, other.frames, other.tapers, other.paints, other.joins, other.details)
        for kind, frame, taper, paint, joins, detail in zip(*columns, strict=True):
            moved = frame @ turn.T
            moved[: 4 if kind == Kind.QUAD else 1] += at
            self.add(Kind(kind), moved, paint, taper, joins, detail)

    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Return the exact lowest and highest corner of all surfaces, metres."""
        return surface_bounds(np.array(self.kinds), np.stack(self.frames), np.array(self.tapers))

    def add(
        self,
        kind: Kind,
        frame: Float[np.ndarray, "4 3"],
        paint: Paint,
        taper: tuple[float, float] = (1.0, 1.0),
        joins: Joins = FREE,
        detail: float = 1.0,
    ) -> None:
        """Add one surface as it is stored."""
        self.kinds.append(int(kind))
        self.frames.append(frame)
        self.tapers.append(taper)
        self.paints.append(paint)
        self.joins.append(joins)
        self.details.append(detail)


def surface_bounds(
    kinds: np.ndarray, frames: Float[np.ndarray, "S 4 3"], tapers: Float[np.ndarray, "S 2"]
) -> Float[np.ndarray, "2 3"]:
    """Return the lowest and highest corner over S surfaces."""
    origin = frames[:, 0]
    rim = np.hypot(frames[:, 1], frames[:, 2])
    ends = np.stack([origin, origin + frames[:, 3]])
    reach = np.stack([rim * tapers[:, :1], rim * tapers[:, 1:]])
    ball = np.sqrt((frames[:, 1:] ** 2).sum(axis=1))
    quad, cone, disc = (kinds == kind for kind in (Kind.QUAD, Kind.CONE, Kind.DISC))
    low, high = origin - ball, origin + ball
    low[quad], high[quad] = frames[quad].min(axis=1), frames[quad].max(axis=1)
    low[cone], high[cone] = (ends - reach).min(axis=0)[cone], (ends + reach).max(axis=0)[cone]
    low[disc], high[disc] = (origin - rim)[disc], (origin + rim)[disc]
    return np.stack([low.min(axis=0), high.max(axis=0)])
