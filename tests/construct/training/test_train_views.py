from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schemas.errors import InputError
from tests.construct import tiny_capture

pytest.importorskip("torch")

from pipeline.construct.training.train_views import TrainViews, extent_of

FRAMES = tiny_capture.frames(tiny_capture.truth(), 3)


def test_at_full_scale_images_are_those_of_the_frame() -> None:
    view = TrainViews(FRAMES, 1024, with_depth=True).view(1, 1.0)
    assert view.camera == FRAMES[1].camera
    assert np.array_equal(np.rint(view.photo.numpy() * 255), FRAMES[1].read_image())
    depth_m = FRAMES[1].read_depth()
    measured = depth_m > 0
    assert np.array_equal(view.inverse_depth.numpy() > 0, measured)
    np.testing.assert_allclose(view.inverse_depth.numpy()[measured], 1 / depth_m[measured], rtol=1e-3)


def test_a_scaled_view_holds_means_and_the_camera_that_goes_with_them() -> None:
    views = TrainViews(FRAMES, 1024, with_depth=True)
    half = views.view(0, 0.5)
    assert (half.camera.width, half.camera.height) == (20, 16)
    assert half.camera.K[0, 0] == FRAMES[0].camera.K[0, 0] / 2
    photo = FRAMES[0].read_image().reshape(16, 2, 20, 2, 3).mean(axis=(1, 3))
    assert np.abs(half.photo.numpy() * 255 - photo).max() <= 1.0
    inverse = views.view(0, 1.0).inverse_depth.numpy().reshape(16, 2, 20, 2).swapaxes(1, 2).reshape(16, 20, 4)
    known = (inverse > 0).sum(axis=2)
    again = views.view(0, 0.5).inverse_depth.numpy()
    assert np.array_equal(again > 0, known >= 2)
    np.testing.assert_allclose(again[known >= 2], (inverse.sum(axis=2) / np.maximum(known, 1))[known >= 2], rtol=2e-3)


def test_large_photographs_are_scaled_down_once_for_all() -> None:
    views = TrainViews(FRAMES, 20, with_depth=False)
    assert views.view(2, 1.0).photo.shape == (16, 20, 3)
    assert views.view(2, 1.0).inverse_depth is None
    assert views.cameras[2].width == 20


def test_a_frame_without_depth_has_none() -> None:
    frames = [FRAMES[0], replace(FRAMES[1], depth=None)]
    views = TrainViews(frames, 1024, with_depth=True)
    assert views.view(0, 1.0).inverse_depth is not None
    assert views.view(1, 1.0).inverse_depth is None


def test_without_frames_there_is_nothing_to_fit() -> None:
    with pytest.raises(InputError, match="photograph"):
        TrainViews([], 1024, with_depth=True)


def test_extent_is_that_of_the_camera_path_and_never_nothing() -> None:
    cameras = tiny_capture.cameras(5)
    centers = np.array([camera.center for camera in cameras])
    farthest = max(np.linalg.norm(center - centers.mean(axis=0)) for center in centers)
    assert extent_of(cameras) == pytest.approx(1.1 * farthest)
    assert extent_of(cameras[:1]) == 0.1
