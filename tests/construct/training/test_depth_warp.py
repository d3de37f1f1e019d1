from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.construct.training.depth_warp import inverse_depth_in
from pipeline.geometry import Camera
from tests.scene import box_room


def _beside(camera: Camera, metres: float) -> Camera:
    pose = camera.world_to_camera.copy()
    pose[0, 3] -= metres
    return camera.moved_to(pose)


def test_the_same_lens_keeps_every_pixel() -> None:
    camera = box_room.cameras()[0]
    depth_m = box_room.depth_m(camera).astype(np.float32)
    depth_m[3, 4] = 0.0
    inverse = inverse_depth_in(depth_m, replace(camera), camera)
    assert inverse[3, 4] == 0.0
    depth_m[3, 4] = inverse[3, 4] = 1.0
    np.testing.assert_allclose(inverse, 1.0 / depth_m, rtol=1e-6)


def test_a_lens_beside_it_gives_the_depth_the_camera_would_measure() -> None:
    lens = box_room.cameras(width=256, height=144)[0]
    camera = _beside(lens, 0.05).resized(128, 72)
    inverse = inverse_depth_in(box_room.depth_m(lens).astype(np.float32), lens, camera)
    known = inverse > 0
    assert known[:, 4:-4].mean() > 0.97
    assert np.abs(inverse * box_room.depth_m(camera) - 1.0)[known].max() < 0.03


def test_the_nearer_surface_hides_the_farther_one() -> None:
    lens = Camera(np.array([[64.0, 0, 32], [0, 64, 32], [0, 0, 1]]), np.eye(4)[:3], 64, 64)
    depth_m = np.full((64, 64), 4.0, np.float32)
    depth_m[16:48, 16:48] = 1.0
    camera = _beside(lens, 0.1)
    inverse = inverse_depth_in(depth_m, lens, camera)
    near = np.zeros((64, 64), bool)
    near[16:48, 16 - 6 : 48 - 7] = True  # moved by 64 * 0.1 / 1 pixels
    assert np.allclose(inverse[near], 1.0)
    right = inverse[16:48, 43:46]  # behind the square when seen by the lens: nothing is known of it
    assert (right == 0.0).all()
    far = inverse[~near & (inverse > 0)]
    assert np.isin(np.round(far, 3), [0.25, 1.0]).all()


def test_what_lies_behind_the_camera_or_beside_its_image_is_left_out() -> None:
    camera = box_room.cameras()[0]
    turned = camera.world_to_camera.copy()
    turned[[0, 2]] *= -1
    inverse = inverse_depth_in(box_room.depth_m(camera).astype(np.float32), camera, camera.moved_to(turned))
    assert (inverse == 0.0).all()
