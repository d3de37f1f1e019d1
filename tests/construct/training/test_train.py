from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene import Gaussians
from schemas.errors import InputError, StoppedError
from tests.construct import tiny_capture

torch = pytest.importorskip("torch")

from pipeline.construct.training.train import Trained, quiet_pixels, train  # noqa: E402
from pipeline.construct.training.train_config import DensityConfig, LearningRates, TrainConfig  # noqa: E402
from pipeline.construct.training.train_state import PARAMETERS  # noqa: E402

TRUTH = tiny_capture.truth()
START = tiny_capture.disturbed(TRUTH)
FRAMES = tiny_capture.frames(TRUTH, 6)
FITTED, HELD_OUT = FRAMES[:2] + FRAMES[3:], FRAMES[2:3]
CONFIG = TrainConfig(
    steps=40,
    sh_degree=1,
    sh_every=0.1,
    scales=((0.0, 0.5), (0.5, 1.0)),
    report_steps=10,
    checkpoint_steps=7,
    density=DensityConfig(every=10, gradient=1e-4, largest_extent=1.0),
    rates=LearningRates(colors=2e-2),
)
"""Every part of the loop takes a turn within these steps: both scales, both degrees, rounds of density control."""
STILL = CONFIG.model_copy(update={"density": DensityConfig(every=0)})
"""The number of Gaussians stays."""


def _same(ours: Gaussians, theirs: Gaussians) -> bool:
    return all(np.array_equal(getattr(ours, name), getattr(theirs, name)) for name in PARAMETERS)


def _told(trained: Trained) -> list[dict[str, object]]:
    return [{**report.as_dict(), "seconds": 0.0} for report in trained.history]


def test_training_finds_the_scene_it_was_moved_away_from() -> None:
    config = STILL.model_copy(update={"steps": 100, "evaluate_steps": 50})
    history = train(START, FITTED, config, held_out=HELD_OUT).history
    start = train(START, FITTED, config.model_copy(update={"steps": 0}), held_out=HELD_OUT).history[0]
    first, last = start.held_out, history[-1].held_out
    assert first is not None
    assert last is not None
    assert last.psnr > first.psnr + 4
    assert last.psnr > 24
    assert last.ssim > first.ssim
    assert [report.step for report in history] == list(range(10, 101, 10))
    assert history[-1].share == 1.0
    assert [report.scale for report in history] == [0.5] * 4 + [1.0] * 6


def test_depth_is_nearer_with_the_depth_loss_than_without() -> None:
    start, errors = tiny_capture.disturbed(TRUTH, by=0.08), []
    for depth_first in (3.0, 0.0):
        config = STILL.model_copy(update={"steps": 60, "depth_first": depth_first, "depth_last": depth_first or 1.0})
        quality = train(start, FITTED, config, held_out=HELD_OUT).history[-1].held_out
        assert quality is not None
        assert quality.depth_abs_m is not None
        errors.append(quality.depth_abs_m)
    assert errors[0] < 0.9 * errors[1]


def test_a_capture_without_depth_trains_and_has_no_depth_error() -> None:
    frames = tiny_capture.frames(TRUTH, 4, with_depth=False)
    config = CONFIG.model_copy(update={"steps": 10})
    quality = train(START, frames[:3], config, held_out=frames[3:]).history[-1].held_out
    assert quality is not None
    assert quality.depth_abs_m is None
    assert quality.psnr > 10


def test_the_same_run_twice_gives_the_same_bits_at_any_thread_count() -> None:
    one = train(START, FITTED, CONFIG)
    two = train(START, FITTED, CONFIG.model_copy(update={"threads": 2, "report_steps": 40}))
    assert len(one.gaussians) > len(START)
    assert _same(one.gaussians, two.gaussians)
    assert not _same(one.gaussians, train(START, FITTED, CONFIG.model_copy(update={"seed": 1})).gaussians)


def test_a_run_that_is_stopped_again_and_again_ends_with_the_same_bits(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"refine_poses": True, "exposure": True})
    whole = train(START, FITTED, config, held_out=HELD_OUT)
    path = tmp_path / "train.npz"
    for session in (1, 2, 3):
        asked = iter(range(100))
        with pytest.raises(StoppedError, match=f"after {13 * session} of 40 steps"):
            train(START, FITTED, config, checkpoint=path, stop=lambda asked=asked: next(asked) >= 13)
    trained = train(START, FITTED, config, checkpoint=path, held_out=HELD_OUT)
    assert _same(trained.gaussians, whole.gaussians)
    assert _told(trained) == _told(whole)


def test_a_finished_run_comes_back_from_its_checkpoint_at_once(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"steps": 9})
    first = train(START, FITTED, config, checkpoint=tmp_path / "train.npz")
    again = train(START, FITTED, config, checkpoint=tmp_path / "train.npz", stop=lambda: True)
    assert _same(first.gaussians, again.gaussians)
    assert first.history == again.history


_KILLED = """
import os, signal, sys
from pathlib import Path
from tests.construct.training import test_train as t
def progress(report):
    if report.step == 20:
        os.kill(os.getpid(), signal.SIGKILL)
t.train(t.START, t.FITTED, t.CONFIG, checkpoint=Path(sys.argv[1]), progress=progress)
"""


def test_a_killed_run_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    path, root = tmp_path / "train.npz", Path(__file__).parents[3]
    killed = subprocess.run([sys.executable, "-c", _KILLED, path], cwd=root, env=os.environ, check=False)
    assert killed.returncode == -signal.SIGKILL
    steps = 0

    def count() -> bool:
        nonlocal steps
        steps += 1
        return False

    trained = train(START, FITTED, CONFIG, checkpoint=path, stop=count)
    assert steps == 40 - 14, "the last checkpoint before step 20 is that of step 14"
    assert _same(trained.gaussians, train(START, FITTED, CONFIG).gaussians)


@pytest.mark.parametrize("what", ["start", "frames", "config"])
def test_another_runs_checkpoint_is_refused(tmp_path: Path, what: str) -> None:
    config = CONFIG.model_copy(update={"steps": 1})
    train(START, FITTED, config, checkpoint=tmp_path / "train.npz")
    start, frames = START, FITTED
    if what == "start":
        start = tiny_capture.disturbed(TRUTH, seed=2)
    elif what == "frames":
        frames = FITTED[:-1]
    else:
        config = config.model_copy(update={"dssim_weight": 0.5})
    with pytest.raises(InputError, match="another run's"):
        train(start, frames, config, checkpoint=tmp_path / "train.npz")


def test_without_steps_the_start_comes_back_with_its_quality() -> None:
    trained = train(START, FITTED, CONFIG.model_copy(update={"steps": 0, "sh_degree": 0}), held_out=HELD_OUT)
    assert np.array_equal(trained.gaussians.means, START.means)
    assert np.array_equal(trained.gaussians.sh, START.sh)
    assert len(trained.history) == 1
    assert trained.history[0].held_out is not None
    assert trained.history[0].psnr is None


def test_time_by_the_given_clock_ends_a_run_before_its_steps_do() -> None:
    ticks = iter(range(1000))
    config = CONFIG.model_copy(update={"steps": 100_000, "minutes": 0.5})
    last = train(START, FITTED, config, clock=lambda: float(next(ticks))).history[-1]
    assert (last.step, last.seconds, last.share, last.scale) == (30, 30.0, 1.0, 1.0)


def test_fitted_exposures_take_a_photographs_brightness_off_the_scene() -> None:
    dimmed = [
        replace(frame, image=tiny_capture.Held((frame.read_image() * (0.7 if k % 2 else 1.0)).astype(np.uint8)))
        for k, frame in enumerate(FITTED)
    ]
    psnrs = []
    for exposure in (False, True):
        config = STILL.model_copy(
            update={"steps": 60, "exposure": exposure, "rates": LearningRates(colors=2e-2, exposures=2e-2)}
        )
        psnrs.append(train(START, dimmed, config).history[-1].psnr)
    assert psnrs[0] is not None
    assert psnrs[1] is not None
    assert psnrs[1] > psnrs[0] + 1


def test_fitted_poses_find_photographs_that_were_moved() -> None:
    rng = np.random.default_rng(0)
    off = []
    for frame in FITTED:
        pose = frame.camera.world_to_camera.copy()
        pose[:, 3] += rng.normal(0, 0.02, 3)
        off.append(replace(frame, camera=frame.camera.moved_to(pose)))
    psnrs = []
    for poses in (False, True):
        rates = LearningRates(poses=2e-3, colors=2e-2)
        config = STILL.model_copy(update={"steps": 100, "refine_poses": poses, "rates": rates})
        psnrs.append(train(TRUTH, off, config).history[-1].psnr)
    assert psnrs[0] is not None
    assert psnrs[1] is not None
    assert psnrs[1] > psnrs[0] + 0.4


def test_quiet_pixels_are_whole_tiles_of_little_error() -> None:
    color, photo = torch.zeros(20, 40, 3), torch.zeros(20, 40, 3)
    photo[3, 20] = 16.0  # one pixel of the second tile
    photo[18:, 33:] = 0.5
    quiet = quiet_pixels(color, photo, 0.05)
    expected = torch.ones(20, 40, dtype=torch.bool)
    expected[:16, 16:32] = False
    expected[16:, 32:] = False
    assert torch.equal(quiet, expected)


def test_a_floor_that_nothing_is_below_changes_no_bit_and_a_high_one_stops_everything() -> None:
    config = CONFIG.model_copy(update={"steps": 12, "depth_first": 0.0})
    plain = train(START, FITTED, config)
    assert _same(plain.gaussians, train(START, FITTED, config.model_copy(update={"tile_error_floor": 1e-9})).gaussians)
    still = train(START, FITTED, config.model_copy(update={"tile_error_floor": 9.0}))
    assert np.array_equal(still.gaussians.means, START.means)


@pytest.mark.parametrize(
    "scales", [(), ((0.1, 1.0),), ((0.0, 0.5), (0.0, 1.0)), ((0.0, 0.0),), ((0.0, 1.0), (1.0, 0.5))]
)
def test_scales_that_make_no_schedule_are_refused(scales: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValueError, match="scales"):
        TrainConfig(scales=scales)
