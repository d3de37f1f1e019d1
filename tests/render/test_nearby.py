"""The Gaussians around a point: all that reach it, with the bits and ids they have in the scene."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.render import nearby, prepare, render
from pipeline.render.prepare import EXTENT
from tests.render.scenes import camera, random_scene


@pytest.mark.parametrize("distance_m", [0.0, 0.3, 1.0, 100.0])
def test_nearby_keeps_exactly_the_gaussians_that_reach_within_the_distance(distance_m: float) -> None:
    scene = random_scene(0, 3000)
    prepared, point = prepare(scene), np.array([0.2, -0.1, 2.0])
    deviations = np.exp(scene.log_scales.astype(np.float64)).max(axis=1)
    reached = np.linalg.norm(scene.means.astype(np.float64) - point, axis=1) - EXTENT * deviations
    kept = nearby(prepared, point, distance_m)
    ids = set(kept.ids[kept.ids >= 0].tolist())
    drawable = set(prepared.ids[prepared.ids >= 0].tolist())
    sure = np.abs(reached - distance_m) > 1e-5
    for id_ in np.flatnonzero(sure):
        assert (int(id_) in ids) == (reached[id_] <= distance_m and int(id_) in drawable)


def test_rendering_what_is_nearby_gives_ids_of_the_scene() -> None:
    scene = random_scene(1, 3000)
    view = camera(64, 48)
    prepared = prepare(scene)
    all_of_it = nearby(prepared, view.center, 1e6)
    part, full = render(all_of_it, view), render(prepared, view)
    np.testing.assert_array_equal(part.dominant, full.dominant)
    np.testing.assert_array_equal(part.color, full.color)


def test_nothing_is_nearby_in_an_empty_place() -> None:
    kept = nearby(prepare(random_scene(2, 200)), np.array([1e5, 0.0, 0.0]), 1.0)
    assert not len(kept.ids)
    assert not render(kept, camera(16, 16), ("alpha",)).alpha.any()
