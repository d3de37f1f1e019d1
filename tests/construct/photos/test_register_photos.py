from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.construct.photos.camera_motion import moved
from pipeline.construct.photos.register_photos import register_photos
from pipeline.geometry import Camera
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame
from tests.construct import tiny_capture

SCENE = tiny_capture.truth(150)
PIXEL_M = 3.0 / 80.0
"""What a pixel of these images spans at the scene, 3 m away."""


def _frames(scene: Gaussians = SCENE) -> list[Frame]:
    return tiny_capture.frames(scene, 5, width=80, height=64)


def _off(frames: list[Frame], metres: float, radians: float) -> list[Frame]:
    rng = np.random.default_rng(0)
    sizes = np.repeat([metres, radians], 3)
    twists = rng.normal(0, 1, (len(frames), 6)) * sizes
    return [replace(f, camera=moved(f.camera, twist)) for f, twist in zip(frames, twists, strict=True)]


def _shift_px(frames: list[Frame], truth: list[Frame]) -> np.ndarray:
    """Return the mean distance between the images of the scene's points under two cameras, for each frame."""

    def pixels(camera: Camera) -> np.ndarray:
        return camera.project(SCENE.means)[0]

    pairs = zip(frames, truth, strict=True)
    return np.array([np.linalg.norm(pixels(a.camera) - pixels(b.camera), axis=1).mean() for a, b in pairs])


def test_photographs_go_back_to_where_they_were_taken() -> None:
    truth = _frames()
    off = _off(truth, 0.02, 0.01)
    found = register_photos(SCENE, off, centered=False)
    assert _shift_px(off, truth).min() > 0.4
    assert _shift_px(list(found.frames), truth).max() < 0.1
    assert (found.error_after < 0.5 * found.error_before).all()


def test_exposure_and_a_thing_the_scene_lacks_do_not_pull_the_camera_away() -> None:
    truth = _frames()
    off = []
    for frame in _off(truth, 0.02, 0.01):
        pixels = (0.8 * frame.read_image() + 10).astype(np.uint8)
        pixels[20:32, 30:44] = (0, 255, 0)
        off.append(replace(frame, image=tiny_capture.Held(pixels)))
    found = register_photos(SCENE, off, centered=False)
    assert _shift_px(list(found.frames), truth).max() < 0.3


def test_depth_keeps_its_lens_and_pose() -> None:
    off = _off(_frames(), 0.02, 0.01)
    found = register_photos(SCENE, off)
    for before, after in zip(off, found.frames, strict=True):
        assert after.depth_lens is before.depth_lens
        assert not np.array_equal(after.camera.world_to_camera, before.camera.world_to_camera)
        assert after.image is before.image


def test_the_mean_motion_is_taken_off_where_asked() -> None:
    shift = np.array([0.03, 0, 0, 0, 0, 0])
    off = [replace(frame, camera=moved(frame.camera, shift)) for frame in _frames()]
    assert register_photos(SCENE, off, centered=True).moved_m.max() < 0.003
    assert register_photos(SCENE, off, centered=False).moved_m.min() > 0.025


def test_a_photograph_of_something_else_stays_where_it_was() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (64, 80, 3), np.uint8)
    frames = _frames()
    frames[2] = replace(frames[2], image=tiny_capture.Held(noise))
    frames[3] = replace(frames[3], image=None)
    found = register_photos(SCENE, frames, centered=False)
    assert (found.error_after <= found.error_before)[[0, 1, 2, 4]].all()
    assert np.isnan(found.error_before[3])
    assert found.moved_m[3] == 0.0
    away = replace(frames[0], camera=frames[0].camera.moved_to(np.eye(4)[:3] + 50 * np.eye(4)[:3, 3:].sum()))
    assert register_photos(SCENE, [away], centered=False).moved_m[0] == 0.0


def test_threads_change_no_bit() -> None:
    off = _off(_frames(), 0.02, 0.01)
    one, two = (register_photos(SCENE, off, threads=threads).frames for threads in (1, 2))
    assert all(
        np.array_equal(a.camera.world_to_camera, b.camera.world_to_camera) for a, b in zip(one, two, strict=True)
    )


@pytest.mark.parametrize("count", [0, 1])
def test_a_few_frames_or_none_are_no_trouble(count: int) -> None:
    assert len(register_photos(SCENE, _frames()[:count]).frames) == count
