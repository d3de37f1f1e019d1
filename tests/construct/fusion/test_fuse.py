"""Depth fusion on rooms whose walls are known: where Gaussians lie, what colour they have, and what is dropped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.fusion.fuse import Fused, fuse
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.fusion.fuse_refit import refit_colors
from pipeline.geometry import quats_to_rotations
from pipeline.metrics.image_quality import depth_errors, psnr
from pipeline.render import render
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame, open_capture
from schemas.errors import InputError
from tests.construct.posed_frames import PLATE_HALF_M, WALL_M, Held, frame, plate_frames, room_frames
from tests.scene import box_room

VOXEL_M = 0.04
PLAIN = FusionConfig(voxel_m=VOXEL_M, fill=False, color_rounds=0)


@pytest.fixture(scope="module")
def room() -> Fused:
    return fuse(room_frames(), PLAIN)


def colors(gaussians: Gaussians) -> np.ndarray:
    return 0.5 + 0.28209479177387814 * gaussians.sh[:, 0]


def test_gaussians_lie_on_the_walls(room: Fused) -> None:
    off = box_room.off_walls_m(room.gaussians.means.astype(np.float64))
    assert np.median(off) < 1e-4
    # Planes through a corner cut it off.
    assert np.percentile(off, 99) < 0.02


def test_gaussians_are_flat_along_the_walls(room: Fused) -> None:
    g = room.gaussians
    assert (g.log_scales[:, 2] < g.log_scales[:, 0] + np.log(0.2)).all()
    assert (g.log_scales.argmin(axis=1) == 2).all()
    normals = quats_to_rotations(g.quats)[:, :, 2]
    straight = np.abs(normals).max(axis=1)
    assert (straight > 0.999).mean() > 0.9


def test_gaussians_have_the_colours_of_the_place(room: Fused) -> None:
    expected = np.clip(room.gaussians.means / box_room.HIGH, 0, 1)
    error = np.abs(colors(room.gaussians) - expected).max(axis=1)
    # 8 bits, and colours between pixels at corners.
    assert np.percentile(error, 95) < 0.01


def test_renders_look_like_the_photographs(room: Fused) -> None:
    for shown in room_frames()[::2]:
        seen = render(room.gaussians, shown.camera, ("color", "depth", "alpha"))
        assert psnr(seen.color, shown.read_image()) > 22  # corners and the image's border are cut off
        error = depth_errors(seen.depth, shown.read_depth())
        assert error.median_abs_m < VOXEL_M  # on a slanted wall the nearer ones cover their neighbours
        assert error.covered > 0.99


def test_noise_of_many_images_is_averaged(room: Fused) -> None:
    noise_m = 0.03
    made = fuse(room_frames(noise_m), PLAIN).gaussians
    off = box_room.off_walls_m(made.means.astype(np.float64))
    # Three or four images see a place, and planes level out more; 5 % of 2 m and more is not taken for noise.
    assert np.sqrt(np.mean(off**2)) < 0.6 * noise_m
    assert len(made) < 2 * len(room.gaussians), "noise made a second layer"


def test_same_frames_give_the_same_bits_with_more_threads(room: Fused) -> None:
    made = fuse(room_frames(), PLAIN.model_copy(update={"threads": 3})).gaussians
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(made, name), getattr(room.gaussians, name))


def with_blob(frames: list[Frame], index: int) -> list[Frame]:
    """Put a disc that is not there 0.6 m before what one frame sees."""
    depth = frames[index].read_depth().copy()
    rows, columns = np.indices(depth.shape)
    depth[(rows - 36) ** 2 + (columns - 64) ** 2 < 12**2] -= 0.6
    return [*frames[:index], replace(frames[index], depth=Held(depth)), *frames[index + 1 :]]


@pytest.mark.parametrize("least_frames", [1, 2])
def test_what_other_images_look_through_goes(least_frames: int) -> None:
    config = PLAIN.model_copy(update={"least_frames": least_frames})
    made = fuse(with_blob(room_frames(), 0), config).gaussians
    assert box_room.off_walls_m(made.means.astype(np.float64)).max() < 0.2


def test_what_a_single_image_says_needs_permission() -> None:
    frames = room_frames()
    alone = [frames[0], frames[-1]]  # they look opposite ways
    agreed, believed = (fuse(alone, PLAIN.model_copy(update={"least_frames": least})).report for least in (2, 1))
    assert agreed.measured < 100
    assert believed.measured > 1000
    assert len(fuse(alone[:1], PLAIN).gaussians) > 1000, "of one frame no more can be asked"


def test_colours_do_not_pass_a_surface_seen_by_another_lens() -> None:
    made = fuse(plate_frames(), PLAIN.model_copy(update={"voxel_m": 0.02})).gaussians
    on_wall = made.means[:, 2] > 1.5
    inside = np.abs(made.means[:, :2]).max(axis=1) < PLATE_HALF_M - 0.02
    assert (on_wall & (np.abs(made.means[:, 2] - WALL_M) < 0.01)).sum() > 1000
    red, blue = colors(made)[:, 0], colors(made)[:, 2]
    assert red[on_wall].max() < 0.02
    assert blue[~on_wall & inside].max() < 0.02
    assert (~on_wall & inside).sum() > 300


def with_window(frames: list[Frame]) -> list[Frame]:
    """Take away the depth of a part of the far wall, as glass does."""
    out = []
    for one in frames:
        depth = one.read_depth().copy()
        world = box_room.world_points(one.camera, box_room.depth_m(one.camera))
        glass = (np.abs(world[..., 0] - box_room.HIGH[0]) < 1e-6) & (np.abs(world[..., 1:] - [2, 1.2]) < 0.35).all(-1)
        depth[glass] = 0
        out.append(replace(one, depth=Held(depth)))
    return out


def test_what_has_no_depth_is_closed_near_its_surroundings() -> None:
    frames = with_window(room_frames())
    hole = frames[0].read_depth() == 0
    assert hole.mean() > 0.01
    left, closed = (fuse(frames, PLAIN.model_copy(update={"fill": fill})) for fill in (False, True))
    assert left.report.guessed == 0
    assert closed.report.guessed > 10
    open_alpha, alpha = (render(f.gaussians, frames[0].camera, ("alpha",)).alpha[hole].mean() for f in (left, closed))
    assert open_alpha < 0.6
    assert alpha > 0.9
    guessed = closed.gaussians.means[closed.report.measured :]
    assert np.median(box_room.off_walls_m(guessed.astype(np.float64))) < 0.05


def test_fitted_colours_are_nearer_to_the_photographs(room: Fused) -> None:
    frames = room_frames()
    seen: list[int] = []
    fitted = refit_colors(room.gaussians, frames, 2, progress=lambda: seen.append(1))
    assert len(seen) == 2 * len(frames)
    for name in ("means", "quats", "log_scales", "opacity_logits"):
        np.testing.assert_array_equal(getattr(fitted, name), getattr(room.gaussians, name))
    before, after = (
        np.mean([np.mean((render(g, f.camera, ("color",)).color - f.read_image() / 255) ** 2) for f in frames])
        for g in (room.gaussians, fitted)
    )
    assert after < 0.8 * before
    threaded = refit_colors(room.gaussians, frames, 2, threads=3)
    np.testing.assert_array_equal(threaded.sh, fitted.sh)


def test_fitted_colours_of_what_nobody_sees_stay(room: Fused) -> None:
    np.testing.assert_array_equal(refit_colors(room.gaussians, [], 1).sh, room.gaussians.sh)


def test_blank_depth_is_counted_and_its_photograph_used() -> None:
    frames = room_frames()
    blank = replace(frames[3], depth=Held(np.zeros_like(frames[3].read_depth())))
    report = fuse([*frames[:3], blank, *frames[4:]], PLAIN).report
    assert [skip.reason for skip in report.skipped] == ["empty depth"]
    assert report.skipped[0].name == frames[3].name
    assert (report.depth_frames, report.color_frames) == (7, 8)


def test_frames_without_depth_or_photograph_lend_what_they_have() -> None:
    frames = room_frames()
    mixed = [replace(f, depth=None) if i % 2 else replace(f, image=None) for i, f in enumerate(frames)]
    report = fuse(mixed, PLAIN.model_copy(update={"least_frames": 1})).report
    assert (report.depth_frames, report.color_frames) == (4, 4)
    assert report.measured > 1000


def test_frames_that_cannot_make_a_scene_are_refused() -> None:
    frames = room_frames()
    for bad, match in (
        ([], "photograph"),
        ([replace(f, image=None) for f in frames], "photograph"),
        ([replace(f, depth=None) for f in frames], "depth image"),
        ([replace(f, depth=Held(np.zeros_like(f.read_depth()))) for f in frames], "8 of 8 depth images are blank"),
    ):
        with pytest.raises(InputError, match=match):
            fuse(bad, PLAIN)


def test_depth_beyond_the_farthest_is_not_used() -> None:
    frames = room_frames()
    made = fuse(frames, PLAIN.model_copy(update={"farthest_m": 2.0, "least_frames": 1})).gaussians
    nearest = np.min([f.camera.project(made.means)[1] + 1e3 * (f.camera.project(made.means)[1] < 0) for f in frames], 0)
    assert nearest.max() < 2.1


def test_poisoned_depth_numbers_do_no_harm(room: Fused) -> None:
    frames = room_frames()
    depth = frames[0].read_depth().copy()
    depth[5:9, 5:9], depth[20:24, 30:34], depth[40:44, 60:64] = np.nan, np.inf, -3.0
    made = fuse([replace(frames[0], depth=Held(depth)), *frames[1:]], PLAIN)
    assert len(made.gaussians) == pytest.approx(len(room.gaussians), rel=0.01)


def test_progress_rises_to_one_and_may_stop_the_work() -> None:
    seen: list[float] = []
    fuse(room_frames(), FusionConfig(voxel_m=VOXEL_M), progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fuse(room_frames(), PLAIN, progress=stop)


def test_one_pixel_wide_images_are_no_crash() -> None:
    camera = box_room.cameras(width=64, height=36)[0].resized(1, 1)
    tiny = frame("tiny", camera, np.zeros((1, 1, 3), np.uint8), np.ones((1, 1)))
    with pytest.raises(InputError, match="agree on"):
        fuse([tiny], PLAIN)


@pytest.mark.slow
def test_kitchen_shows_frames_it_was_not_built_from(shared_data: Path) -> None:
    frames = open_capture(str(shared_data / "kitchen_7scenes")).frames
    made = fuse([f for i, f in enumerate(frames) if i % 5 != 4], FusionConfig(voxel_m=0.02, threads=2)).gaussians
    decibels, close = [], []
    for shown in frames[4::5]:
        decibels.append(psnr(render(made, shown.camera, ("color",)).color, shown.read_image()))
        depth = render(made, shown.depth_lens, ("depth",)).depth
        close.append(depth_errors(depth, shown.read_depth()).within_5cm)
    assert np.mean(decibels) > 18.5
    assert np.mean(close) > 0.8
