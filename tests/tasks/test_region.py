from __future__ import annotations

import numpy as np

from pipeline.tasks.region import GroundingConfig, frustum_region
from tests.query.tiny import camera_at, tiny_scene


def test_region_is_the_activated_gaussians_whose_centres_project_into_the_image() -> None:
    scene = tiny_scene()
    activated = np.arange(0, len(scene.gaussians), 3, dtype=np.int32)
    for view in scene.views:
        camera, expected = view.camera, []
        for j in activated.tolist():
            x, y, z = camera.world_to_camera[:, :3] @ scene.gaussians.means[j] + camera.world_to_camera[:, 3]
            u, v = camera.K[0, 0] * x / z + camera.K[0, 2], camera.K[1, 1] * y / z + camera.K[1, 2]
            if 0.2 < z <= 100 and 0 <= u < camera.width and 0 <= v < camera.height:
                expected.append(j)
        assert frustum_region(camera, activated, scene.gaussians.means, GroundingConfig()).tolist() == expected


def test_what_a_wall_hides_stays_in_the_region() -> None:
    scene = tiny_scene()
    hidden = np.flatnonzero(scene.semantics.instance == 4).astype(np.int32)
    region = frustum_region(camera_at((0, 0, 1), (0, 7, 0.4)), hidden, scene.gaussians.means, GroundingConfig())
    assert region.tolist() == hidden.tolist()


def test_planes_cut_the_region() -> None:
    means = np.array([[0, d, 1] for d in (0.1, 0.5, 2.0, 5.0)], np.float32)
    ids = np.arange(4, dtype=np.int32)
    camera = camera_at((0, 0, 1), (0, 3, 1))
    assert frustum_region(camera, ids, means, GroundingConfig()).tolist() == [1, 2, 3]
    assert frustum_region(camera, ids, means, GroundingConfig(near_m=1.0, far_m=3.0)).tolist() == [2]


def test_nothing_activated_gives_an_empty_region() -> None:
    region = frustum_region(
        camera_at((0, 0, 1), (0, 3, 1)), np.empty(0, np.int32), np.zeros((4, 3), np.float32), GroundingConfig()
    )
    assert region.shape == (0,)
