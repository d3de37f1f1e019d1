"""Photographs are moved where ones that were left out of the trial fit better for it, and only there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.fusion.fuse import fuse
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.photos.build_photos import LEAST_FRAMES, PhotoTrial, place_photos, try_photos
from pipeline.construct.photos.camera_motion import moved
from pipeline.scene.captures import Capture, Frame, open_capture
from tests.construct import tiny_capture

CONFIG = FusionConfig(voxel_m=0.03, threads=2)


@pytest.fixture(scope="module")
def true() -> list[Frame]:
    return tiny_capture.frames(tiny_capture.truth(150), LEAST_FRAMES, width=80, height=64)


@pytest.fixture(scope="module")
def off(true: list[Frame]) -> list[Frame]:
    """Photographs a pixel or so away from where they are said to be, each another way; depth is right."""
    twists = np.random.default_rng(0).normal(0, 1, (len(true), 6)) * np.repeat([0.02, 0.015], 3)
    return [
        replace(frame, camera=moved(frame.camera, twist), depth_camera=frame.camera)
        for frame, twist in zip(true, twists, strict=True)
    ]


@pytest.mark.parametrize(
    ("falls", "pays"),
    [
        ((0.024, 0.028, 0.046, 0.046, 0.037, 0.034), True),
        ((-0.004, 0.012, 0.055, 0.057, 0.055, 0.022), True),
        ((0.004, -0.005, 0.024, -0.023, 0.01, -0.006), False),
        ((0.016, 0.006, 0.003, 0.001, 0.017, 0.016), False),
        ((0.014, 0.035, 0.04, 0.0, -0.029, 0.048), False),
        ((0.15, -0.02, -0.02, -0.01), False),
        ((0.05, 0.05, 0.05, float("nan")), False),
    ],
    ids=["kitchen", "kitchen's end", "apartment", "its middle", "its end", "by chance", "blind judge"],
)
def test_trial_pays_where_judges_fit_clearly_better(falls: tuple[float, ...], pays: bool) -> None:
    assert PhotoTrial(np.array(falls)).pays is pays


def test_trial_of_right_photographs_leaves_them(true: list[Frame]) -> None:
    told: list[float] = []
    trial = try_photos(true, CONFIG, progress=told.append)
    assert trial is not None
    assert len(trial.falls) == 4
    assert np.isfinite(trial.falls).all()
    assert not trial.pays
    assert max(told) == told[-1] == 1.0


@pytest.mark.slow
def test_photographs_of_the_kitchen_are_out_of_step(shared_data: Path) -> None:
    trial = try_photos(open_capture(str(shared_data / "kitchen_7scenes")).frames, FusionConfig(voxel_m=0.02, threads=2))
    assert trial is not None
    assert trial.pays


def test_too_few_frames_to_judge_are_no_trial(off: list[Frame]) -> None:
    dark = replace(off[0], image=None)
    assert try_photos([*off[: LEAST_FRAMES - 1], dark], CONFIG) is None


def test_moved_photographs_leave_depth_where_it_was(off: list[Frame]) -> None:
    capture = Capture("tiny", tuple(off[:6]))
    placed, count = place_photos(capture, fuse(capture.frames, CONFIG).gaussians, threads=2)
    assert count == 6
    for before, after in zip(capture.frames, placed.frames, strict=True):
        assert np.array_equal(after.depth_lens.world_to_camera, before.depth_lens.world_to_camera)
        assert not np.array_equal(after.camera.world_to_camera, before.camera.world_to_camera)
