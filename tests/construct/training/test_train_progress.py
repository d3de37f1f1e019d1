from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.construct.photos.camera_motion import moved
from pipeline.construct.training.train_progress import HeldOutQuality, TrainProgress, held_out_quality
from pipeline.metrics.image_quality import psnr
from pipeline.render import render
from schemas.errors import StoppedError
from tests.construct import tiny_capture

SCENE = tiny_capture.truth(150)
FRAMES = tiny_capture.frames(SCENE, 3, width=80, height=64)


def test_a_perfect_scene_differs_by_the_photographs_rounding_alone() -> None:
    quality = held_out_quality(SCENE, FRAMES)
    assert quality.frames == 3
    assert quality.psnr > 55
    assert quality.ssim > 0.999
    assert quality.depth_abs_m == pytest.approx(0.0, abs=1e-5)
    assert quality.depth_within_5cm == 1.0
    assert quality.aligned_psnr is None


def test_measuring_tells_how_far_it_is_and_ends_where_the_one_told_says_so() -> None:
    told: list[float] = []
    held_out_quality(SCENE, FRAMES[:2], aligned=True, progress=told.append)
    assert told == [0.0, 0.25, 0.75, 1.0]

    def enough(share: float) -> None:
        if share > 0:
            raise StoppedError("enough")

    with pytest.raises(StoppedError):
        held_out_quality(SCENE, FRAMES, progress=enough)


def test_figures_are_means_over_frames() -> None:
    scene = tiny_capture.disturbed(SCENE)
    each = [psnr(render(scene, f.camera, ("color",)).color, f.read_image()) for f in FRAMES]
    assert held_out_quality(scene, FRAMES).psnr == pytest.approx(np.mean(each))


def test_aligned_figures_see_past_pose_and_exposed_ones_past_brightness() -> None:
    off = []
    for k, frame in enumerate(FRAMES):
        camera = moved(frame.camera, 0.01 * np.array([1.0, -2, 1, 0.5 * k, -0.5, 0.3]))
        dimmed = (0.8 * frame.read_image() + 20).astype(np.uint8)
        off.append(replace(frame, camera=camera, image=tiny_capture.Held(dimmed), depth=None))
    quality = held_out_quality(SCENE, off, aligned=True)
    assert quality.aligned_psnr is not None
    assert quality.exposed_psnr is not None
    assert quality.psnr < quality.aligned_psnr < quality.exposed_psnr
    assert quality.exposed_psnr > 40
    assert quality.depth_abs_m is None
    assert quality.psnr == held_out_quality(SCENE, off).psnr


def test_a_report_comes_back_from_plain_values() -> None:
    report = TrainProgress(3, 9, 1 / 3, 1.5, 60, 0.5, 0.1, 20.0, HeldOutQuality(1, 20.0, 0.5, None, None))
    assert TrainProgress.from_dict(report.as_dict()) == report
    bare = replace(report, held_out=None)
    assert TrainProgress.from_dict(bare.as_dict()) == bare
