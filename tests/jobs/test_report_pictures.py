"""Overlays, maps and the places of scenes: pixels that belong to a group, metres that come out right."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from jobs.dataset import scene_sha256
from jobs.drawing.map_frame import axes_of, frame_of, up_of
from jobs.drawing.overlays import COLORS, EDGE, FILL, groups_image, outline, overlay
from jobs.drawing.scene_places import PlannedScene, find_scene
from jobs.drawing.to_draw import ToDraw
from jobs.drawing.top_down import HEIGHT_M, map_camera
from jobs.report.drawing import draw_scene
from jobs.report.shards import DataFolder
from pipeline.config import MethodConfig
from pipeline.scene.load import load_scene
from schemas.errors import InputError
from tests.jobs.blobs import save_balls

LEAN = 0.03
"""Share by which heights of 2 m move on a map that is seen from `HEIGHT_M`."""


def test_groups_image_gives_each_pixel_the_group_of_its_gaussian() -> None:
    dominant = np.array([[0, 1, 2], [3, -1, 0]], np.int32)
    groups = [np.array([1], np.int32), np.array([0, 1, 4], np.int32)]
    np.testing.assert_array_equal(groups_image(dominant, groups, 5), [[2, 1, 0], [0, 0, 2]])


def test_groups_image_nothing_drawn_when_the_last_gaussian_is_a_member_and_a_pixel_is_empty() -> None:
    found = groups_image(np.array([[-1, 4]], np.int32), [np.array([4], np.int32)], 5)
    np.testing.assert_array_equal(found, [[0, 1]])


@given(arrays(bool, (9, 12)), st.integers(1, 3))
def test_outline_is_outside_the_mask_and_near_it(mask: np.ndarray, pixels: int) -> None:
    found = outline(mask, pixels)
    assert not (found & mask).any()
    assert found.shape == mask.shape
    for y, x in np.argwhere(found):
        steps = np.abs(np.argwhere(mask) - (y, x)).sum(axis=1)
        assert steps.min() <= pixels + 2


def test_overlay_fills_one_group_outlines_the_others_and_is_clear_elsewhere() -> None:
    labels = np.zeros((40, 60), np.uint8)
    labels[5:15, 5:15], labels[5:15, 40:50] = 1, 2
    picture = np.asarray(Image.open(io.BytesIO(overlay(labels, filled=1))).convert("RGBA"))
    first, second = (tuple(bytes.fromhex(color[1:])) for color in COLORS[:2])
    assert tuple(picture[10, 10]) == (*first, FILL)
    assert tuple(picture[10, 4]) == (*first, EDGE)
    assert picture[10, 45, 3] == 0
    assert tuple(picture[10, 39]) == (*second, EDGE)
    assert picture[30, 30, 3] == 0


def test_overlay_truth_is_outlined_in_white_even_where_nothing_was_found() -> None:
    truth = np.zeros((40, 60), bool)
    truth[10:20, 10:20] = True
    picture = np.asarray(Image.open(io.BytesIO(overlay(np.zeros((40, 60), np.uint8), truth=truth))).convert("RGBA"))
    assert tuple(picture[15, 9]) == (255, 255, 255, EDGE)
    assert picture[15, 15, 3] == 0


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.1, 0.2, 0.97)])
def test_map_camera_sees_points_where_the_frame_says(up: tuple[float, float, float]) -> None:
    above = np.array(up) / np.linalg.norm(up)
    right, down = axes_of(above)
    np.testing.assert_allclose(np.cross(right, down), -above, atol=1e-12)
    rng = np.random.default_rng(0)
    flat = rng.uniform(-4, 4, (50, 1)) * right + rng.uniform(-2, 2, (50, 1)) * down
    frame = frame_of(above, flat, flat)
    camera = map_camera(frame, above, 1.0)
    pixels, depth = camera.project(flat)
    per_metre = camera.width / frame.size[0]
    np.testing.assert_allclose(pixels / per_metre, frame.at(flat), atol=LEAN * float(frame.size.max()))
    np.testing.assert_allclose(depth, HEIGHT_M + 1.0)
    assert (frame.at(flat) > 0).all()
    assert (frame.at(flat) < frame.size).all()


def test_up_of_level_cameras_is_against_their_y() -> None:
    pose = [1.0, 0, 0, 0, 0, 0, -1.0, 0, 0, 1.0, 0, 0]
    np.testing.assert_allclose(up_of([pose, pose]), [0, 0, 1])
    np.testing.assert_allclose(up_of([]), [0, 0, 1])


def test_find_scene_relative_path_is_found_above_the_run_and_changed_files_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "h" / "scenes" / "flat"
    folder.mkdir(parents=True)
    (folder / "gaussians.ply").write_bytes(b"splats")
    run = tmp_path / "h" / "run"
    run.mkdir()
    monkeypatch.chdir(run)
    scene = PlannedScene("flat", "h/scenes/flat", scene_sha256(str(folder)))
    assert find_scene(str(run), scene).uri == str(folder)
    assert find_scene(str(run), scene, str(tmp_path / "h" / "scenes")).uri == str(folder)
    assert "no folder of that name" in find_scene(str(run), scene, str(tmp_path)).problem
    (folder / "gaussians.ply").write_bytes(b"other splats")
    assert "changed" in find_scene(str(run), scene).problem


@pytest.fixture
def two_balls(tmp_path: Path) -> Path:
    return save_balls(tmp_path)


def test_draw_scene_overlays_fall_on_their_cluster_and_truth_on_the_target(two_balls: Path, tmp_path: Path) -> None:
    scene = load_scene(str(two_balls))
    centres = [
        scene.gaussians.means[part].mean(axis=0, dtype=np.float64).tolist() for part in (slice(40), slice(40, 80))
    ]
    clusters = [
        {"cluster": number, "category": "ball", "gaussians": 40, "centre": centre, "initial_view": "front"}
        for number, centre in enumerate(centres)
    ]
    pose = scene.views[0].camera.world_to_camera.ravel().tolist()
    view = {"candidate": "front", "move": "initial", "world_to_camera": pose, "source": "render"}
    regions = [{"view": "front", "instance": 0, "gaussians": list(range(40))}]
    question = ToDraw("q", clusters, [{**view, "cluster": number} for number in (0, 1)], regions, (1,))
    lost = ToDraw("lost", [{**clusters[0], "gaussians": 39}], [{**view, "cluster": 0}], [], ())
    folder = DataFolder(str(tmp_path / "data"), "data")
    method = MethodConfig().model_dump(mode="json") | {"kind": "splatreasoner"}
    asked: list[bool] = []

    def goes_on() -> bool:
        asked.append(True)
        return len(asked) < 3

    drawn = draw_scene(str(two_balls), method, [question, lost, question], folder, threads=1, goes_on=goes_on)
    assert set(drawn.questions) == {"q", "lost"}
    assert drawn.questions["lost"]["views"] == {}, "a cluster that does not come out the same is not drawn"
    left, right = (_opacity(tmp_path, drawn.questions["q"]["views"][f"{n}/front"]["overlay"]) for n in (0, 1))
    assert (left == FILL).any()
    assert np.argwhere(left == FILL)[:, 1].max() < 32 < np.argwhere(right == FILL)[:, 1].min()
    (grounded,) = drawn.questions["q"]["grounded"]
    found = _picture(tmp_path, grounded["overlay"])
    white = (found[..., :3] == 255).all(axis=-1) & (found[..., 3] == EDGE)
    assert np.argwhere(white)[:, 1].min() > 32, "the target is the right one, the answer the left one"
    assert np.argwhere(found[..., 3] == FILL)[:, 1].max() < 32
    dots = _opacity(tmp_path, drawn.questions["q"]["dots"])
    assert dots.shape == _picture(tmp_path, drawn.map["image"]).shape[:2]
    width = drawn.map["size"][0]
    columns = np.argwhere(dots > 0)[:, 1] / dots.shape[1] * width + drawn.map["low"][0]
    assert abs(columns.min() + 1) < 0.3
    assert abs(columns.max() - 1) < 0.3


def test_draw_scene_method_of_another_version_is_an_input_error(tmp_path: Path) -> None:
    method, folder = {"kind": "splatreasoner", "later": 1}, DataFolder(str(tmp_path), "data")
    with pytest.raises(InputError, match="fields of this version"):
        draw_scene(str(tmp_path), method, [], folder, threads=1, goes_on=lambda: True)


def _picture(folder: Path, link: str) -> np.ndarray:
    return np.asarray(Image.open(folder / link).convert("RGBA"))


def _opacity(folder: Path, link: str) -> np.ndarray:
    return _picture(folder, link)[..., 3]
