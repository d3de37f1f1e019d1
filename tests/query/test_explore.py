from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.geometry import Camera
from pipeline.query.explore import Explorer
from pipeline.query.explore_config import ExploreConfig
from pipeline.render import prepare, visible_ids
from pipeline.scene.scene import Scene
from pipeline.scene.semantics import Semantics
from tests.query.tiny import UP, gaussians_at, tiny_scene

TABLE = 2
"""Instance number of the table in the tiny scene."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene()


def _explorer(scene: Scene, **config: object) -> Explorer:
    seen = np.ones(len(scene.gaussians), np.int32)
    return Explorer(scene, prepare(scene.gaussians), seen, ExploreConfig(long_side=48, **config))


@pytest.fixture(scope="module")
def explorer(scene: Scene) -> Explorer:
    return _explorer(scene)


def _instance(scene: Scene, number: int) -> np.ndarray:
    return np.flatnonzero(scene.semantics.instance == number).astype(np.int32)


def _visibility(scene: Scene, camera: Camera, cluster: np.ndarray) -> float:
    return float(np.isin(cluster, visible_ids(scene.gaussians, camera)).mean())


def test_first_view_shows_more_than_the_best_recorded_one(scene: Scene, explorer: Explorer) -> None:
    for number in (0, 1, TABLE):
        cluster = _instance(scene, number)
        recorded = max(_visibility(scene, view.camera, cluster) for view in scene.views)
        first, *_ = explorer.explore(cluster, scene.views[0].camera, 2)
        assert _visibility(scene, first, cluster) > recorded


def test_views_are_upright_have_the_lens_and_stand_where_the_space_allows(scene: Scene, explorer: Explorer) -> None:
    lens = scene.views[0].camera
    found = explorer.explore(_instance(scene, TABLE), lens, 4)
    assert len(found) == 4
    for camera in found:
        np.testing.assert_array_equal(camera.K, lens.K)
        assert (camera.width, camera.height) == (lens.width, lens.height)
        assert camera.world_to_camera[0, :3] @ UP == pytest.approx(0, abs=1e-9), "the horizon is level"
        assert camera.world_to_camera[1, :3] @ UP < 0, "image y runs down"
        assert np.linalg.norm(explorer.space.stands - camera.center, axis=1).min() <= explorer.space.cell_m
    assert len({camera.world_to_camera.tobytes() for camera in found}) == 4


def test_later_views_show_what_the_first_does_not(scene: Scene) -> None:
    cluster = _instance(scene, TABLE)
    first, second = _explorer(scene, reach_m=4.0).explore(cluster, scene.views[0].camera, 2)
    shown = [np.intersect1d(visible_ids(scene.gaussians, camera), cluster) for camera in (first, second)]
    assert len(np.setdiff1d(shown[1], shown[0])) > 0.05 * len(cluster)


def test_more_views_begin_with_the_same_first_one(scene: Scene) -> None:
    """With no steps to refine, the pool does not depend on how many views are wanted."""
    explorer = _explorer(scene, refine=0.0)
    cluster = _instance(scene, TABLE)
    two, three = (explorer.explore(cluster, scene.views[0].camera, count) for count in (2, 3))
    for one, other in zip(two, three, strict=False):
        np.testing.assert_array_equal(one.world_to_camera, other.world_to_camera)


def test_search_is_the_same_again_and_with_two_threads(scene: Scene, explorer: Explorer) -> None:
    cluster, lens = _instance(scene, 0), scene.views[0].camera
    seen = np.ones(len(scene.gaussians), np.int32)
    other = Explorer(scene, prepare(scene.gaussians), seen, ExploreConfig(long_side=48), threads=2)
    found = [one.explore(cluster, lens, 3) for one in (explorer, other)]
    for first, again in zip(*found, strict=True):
        np.testing.assert_array_equal(first.world_to_camera, again.world_to_camera)


@pytest.mark.parametrize("renders", [1, 5, 20])
def test_renders_stay_within_their_budget_and_are_not_repeated(scene: Scene, renders: int) -> None:
    explorer = _explorer(scene, renders=renders)
    cluster = _instance(scene, TABLE)
    found = explorer.explore(cluster, scene.views[0].camera, 2)
    assert 1 <= explorer.renders <= renders
    assert len(found) == min(2, renders)
    spent = explorer.renders
    assert explorer.explore(cluster, scene.views[0].camera, 2) is found
    assert explorer.renders == spent


def test_refining_does_not_lower_what_is_seen(scene: Scene) -> None:
    cluster, lens = _instance(scene, TABLE), scene.views[0].camera
    plain, refined = (
        _explorer(scene, renders=renders, refine=refine).explore(cluster, lens, 1)[0]
        for renders, refine in ((8, 0.0), (40, 0.8))
    )
    assert _visibility(scene, refined, cluster) >= _visibility(scene, plain, cluster)


def test_nothing_is_found_where_no_place_is_near_enough(scene: Scene) -> None:
    far = dataclasses.replace(scene, views=scene.views[:1])
    assert _explorer(far, farthest_m=0.5, reach_m=0.3).explore(_instance(scene, 4), scene.views[0].camera, 2) == ()


def test_unobserved_surfaces_are_avoided(scene: Scene) -> None:
    """The side of the table that faces the wall is taken as never seen, with all that lies behind it."""
    cluster, lens = _instance(scene, TABLE), scene.views[0].camera
    seen = np.where(scene.gaussians.means[:, 1] > 3.15, 0, 1).astype(np.int32)
    config = ExploreConfig(long_side=48, reach_m=6.0)
    careful = Explorer(scene, prepare(scene.gaussians), seen, config)
    weights = config.weights.model_copy(update={"unobserved": 0.0})
    careless = Explorer(scene, prepare(scene.gaussians), seen, config.model_copy(update={"weights": weights}))

    def share(explorer: Explorer) -> float:
        dominant = [visible_ids(scene.gaussians, camera) for camera in explorer.explore(cluster, lens, 3)]
        return float(np.mean([(seen[ids] == 0).mean() for ids in dominant]))

    assert share(careful) < share(careless)


def test_cluster_around_the_cameras_is_looked_at_from_inside(scene: Scene) -> None:
    """Its middle is a free place, where no camera can look at it."""
    ring = np.array([[np.cos(a) * 3, np.sin(a) * 3, 1.0] for a in np.linspace(0, 2 * np.pi, 200)])
    semantics = Semantics(("wall",), np.zeros(200, np.int32))
    room = dataclasses.replace(scene, gaussians=gaussians_at(ring), semantics=semantics)
    explorer = Explorer(room, prepare(room.gaussians), np.ones(200, np.int32), ExploreConfig(long_side=48, reach_m=3.0))
    found = explorer.explore(np.arange(200, dtype=np.int32), scene.views[0].camera, 4)
    assert len(found) == 4
    assert all(np.isfinite(camera.world_to_camera).all() for camera in found)
