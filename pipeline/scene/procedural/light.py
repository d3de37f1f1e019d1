"""Light: brightness by direction, darker floor near and under furniture, and a warm glow about lamps that are on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pipeline.scene.procedural.things import Placed

SKY = np.array([0.05, 0.035, 0.07])
"""How much more light comes from +x, +y and +z than from the other side."""
AMBIENT = 0.925
"""Light on a surface that faces sideways, on average."""
SHADOW_DEPTH, SHADOW_REACH_M = 0.22, 0.15
"""Darkening of the floor under furniture, and how far beside it that fades."""
GLOW, GLOW_REACH_M = 0.16, 1.0
"""Extra light next to a lamp, and the distance at which half of it is left."""


@dataclass(frozen=True, slots=True)
class Light:
    """What lights and shades the apartment."""

    shadows: Float[np.ndarray, "K 5"]
    """Room, then low x, low y, high x, high y of every footprint on the floor, metres."""
    lamps: Float[np.ndarray, "L 4"]
    """Room, then position of every lamp that is on, metres."""

    @classmethod
    def of(cls, things: list[Placed]) -> Light:
        """Return the light of placed things."""
        shadows, lamps = [], []
        for thing in things:
            low, high = thing.box
            if low[2] < 0.4 and 0.08 < high[2] < 2.4 and thing.model.category not in ("wall", "floor", "ceiling"):
                inset = np.minimum(0.04, (high[:2] - low[:2]) / 4)
                shadows.append([thing.room, *(low[:2] + inset), *(high[:2] - inset)])
            if thing.model.light is not None:
                lamps.append([thing.room, *thing.to_world(np.array(thing.model.light))])
        return cls(np.array(shadows).reshape(-1, 5), np.array(lamps).reshape(-1, 4))

    def shade(
        self,
        point: Float[np.ndarray, "n 3"],
        normal: Float[np.ndarray, "n 3"],
        room: Int[np.ndarray, "n"],
        on_floor: np.ndarray,
        glow: Float[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n 3"]:
        """Return the factor by which light changes each colour channel.

        Args:
            point: World positions.
            normal: Unit world normals.
            room: Room of each point.
            on_floor: Whether the point is on a floor and takes shadows.
            glow: 1 for surfaces that shine by themselves and take no shading.
        """
        factor = AMBIENT + normal @ SKY
        # Light fails a little towards the foot of everything, as it does in rooms lit from above.
        factor -= 0.05 * np.exp(-np.maximum(point[:, 2], 0.0) / 0.25) * (np.abs(normal[:, 2]) < 0.5)
        factor[on_floor] *= 1 - self._shadow(point[on_floor], room[on_floor])
        warm = self._warmth(point, normal, room)
        lit = factor[:, None] + warm[:, None] * np.array([1.0, 0.93, 0.72])
        return lit * (1 - glow[:, None]) + glow[:, None]

    def _shadow(self, point: np.ndarray, room: np.ndarray) -> np.ndarray:
        dark = np.zeros(len(point))
        for number in np.unique(room):
            rows = np.flatnonzero(room == number)
            xy = point[rows, :2]
            for _, x0, y0, x1, y1 in self.shadows[self.shadows[:, 0] == number]:
                dx = np.maximum(np.maximum(x0 - xy[:, 0], xy[:, 0] - x1), 0)
                dy = np.maximum(np.maximum(y0 - xy[:, 1], xy[:, 1] - y1), 0)
                near = np.hypot(dx, dy) / SHADOW_REACH_M
                dark[rows] = np.maximum(dark[rows], SHADOW_DEPTH * np.exp(-(near**2)))
        return dark

    def _warmth(self, point: np.ndarray, normal: np.ndarray, room: np.ndarray) -> np.ndarray:
        warm = np.zeros(len(point))
        for number, x, y, z in self.lamps:
            rows = np.flatnonzero(room == number)
            to_lamp = np.array([x, y, z]) - point[rows]
            distance = np.linalg.norm(to_lamp, axis=1)
            facing = np.maximum((to_lamp * normal[rows]).sum(axis=1) / np.maximum(distance, 1e-3), 0)
            warm[rows] += GLOW * (0.3 + 0.7 * facing) / (1 + (distance / GLOW_REACH_M) ** 2)
        return np.minimum(warm, 1.5 * GLOW)
