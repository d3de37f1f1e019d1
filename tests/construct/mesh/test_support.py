"""Support read off points: what rests on what, what stands under what, and when nothing is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.construct.mesh.support import state_support
from pipeline.scene.objects import SceneObject


def top_and_sides(center: tuple[float, float, float], half: tuple[float, float, float]) -> np.ndarray:
    """Points 4 cm apart on a box's faces, as a scanner sees them, without the underside."""
    axes = [np.linspace(-h, h, max(2, int(2 * h / 0.04) + 2)) for h in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    on_face = (np.abs(np.abs(grid) - np.array(half)) < 1e-9) @ np.ones(3) > 0
    below = np.isclose(grid[:, 2], -half[2]) & (np.abs(grid[:, :2]) < np.array(half[:2]) - 1e-9).all(axis=1)
    return grid[on_face & ~below] + np.array(center)


TABLE = SceneObject(0, "table", "", (0.0, 0.0, 0.7), (0.6, 0.5, 0.03))
LAMP = SceneObject(1, "lamp", "", (0.2, 0.1, 0.93), (0.1, 0.1, 0.2))


def place(*objects: SceneObject) -> list[tuple[int, str]]:
    points = {o.instance: top_and_sides(o.center, o.half_extents) for o in objects}
    return [(o.parent, o.relation) for o in state_support(objects, points, 0.0)]


def test_a_lamp_on_a_table_is_on_it() -> None:
    assert place(TABLE, LAMP) == [(-1, ""), (0, "on")]


@pytest.mark.parametrize("center", [(0.2, 0.1, 1.4), (0.8, 0.1, 0.93), (0.2, 0.1, 0.6)])
def test_a_lamp_over_beside_or_through_the_table_is_not_on_it(center: tuple[float, float, float]) -> None:
    assert place(TABLE, replace(LAMP, center=center))[1] == (-1, "")


def test_a_bin_standing_under_a_table_is_under_it() -> None:
    low = replace(LAMP, category="bin", center=(0.2, 0.1, 0.2))
    assert place(TABLE, low)[1] == (0, "under")


def test_two_possible_supports_say_nothing() -> None:
    second = replace(TABLE, instance=2, center=(0.2, 0.0, 0.7))
    assert place(TABLE, LAMP, second)[1] == (-1, "")


@pytest.mark.parametrize("category", ["window", "wall", "curtain"])
def test_what_hangs_rests_on_nothing(category: str) -> None:
    assert place(TABLE, replace(LAMP, category=category))[1] == (-1, "")
