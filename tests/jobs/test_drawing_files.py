"""Pictures as files: a map whose signs lie where things are, a question's views and groundings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from jobs.cli import app
from jobs.drawing.map_frame import frame_of
from jobs.drawing.map_pen import INK, MapPen
from jobs.drawing.map_sheet import SHEET_SIDE, map_sheet, scene_map
from jobs.drawing.overlays import laid_over, overlay, rgb_of
from jobs.drawing.question import QuestionArtist
from jobs.drawing.run_scene import RunScene
from jobs.drawing.top_down import map_labels
from jobs.verbs.render import render
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError
from tests.jobs.blobs import EACH, HOSTILE, save_balls


def test_laid_over_filled_pixels_are_mixed_and_others_stay() -> None:
    labels = np.zeros((30, 40), np.uint8)
    labels[10:20, 10:20] = 1
    found = laid_over(np.full((30, 40, 3), 100, np.uint8), [overlay(labels)])
    assert (found[25, 35] == 100).all()
    between = np.abs(found[15, 15].astype(int) - (100 + np.array(rgb_of(0))) / 2)
    assert (between < 12).all(), "about half the group's colour"


def test_map_labels_small_group_lies_over_large_one_and_outside_is_left_out() -> None:
    up, corners = np.array([0.0, 0, 1]), np.array([[-2.0, -2, 0], [2, 2, 0]])
    frame = frame_of(up, corners, corners)
    means = np.array([[0.0, 0, 0], [0, 0, 1], [1, 1, 0], [50, 0, 0]], np.float32)
    groups = {0: np.array([0, 2, 3], np.int32), 4: np.array([1], np.int32)}
    labels = map_labels(frame, means, groups)
    x, y = (frame.at(means[:1])[0] * frame.per_metre(720)).astype(int)
    assert labels[y, x] == 5
    assert set(np.unique(labels)) == {0, 1, 5}


def test_map_sheet_marks_chosen_views_clusters_and_path_where_they_are(balls: Path, balls_run: str) -> None:
    context, asked = SceneContext(load_scene(str(balls))), RunScene(balls_run, str(balls))
    question = asked.to_draw("one/ball")
    groups = QuestionArtist(context, asked.method).clusters(question)
    assert {len(ids) for ids in groups.values()} == {EACH}
    base = scene_map(context)
    sheet = map_sheet(base, context.scene.gaussians.means, question, groups)
    height = base.picture.shape[0]
    assert sheet.shape[0] > height, "scale and legend lie below"
    scale = base.frame.per_metre(SHEET_SIDE)
    for row in question.clusters:
        x, y = (base.frame.at(np.array(row["centre"])[None])[0] * scale).astype(int)
        around = sheet[y - 12 : y + 12, x - 12 : x + 12]
        assert (around == rgb_of(int(row["cluster"]))).all(axis=-1).any()
    bare = map_sheet(base, context.scene.gaussians.means)
    x, y = (base.path[0] * scale).astype(int)
    assert not (bare[y - 2 : y + 2, x - 2 : x + 2] == base.picture[y - 2 : y + 2, x - 2 : x + 2]).all()
    assert not (bare[:height] == sheet[:height]).all()


def test_map_pen_legend_wraps_so_that_nothing_is_cut_off() -> None:
    frame = frame_of(np.array([0.0, 0, 1]), np.array([[-2.0, -2, 0], [2, 2, 0]]), np.zeros((1, 3)))
    pen = MapPen(frame, SHEET_SIDE)
    clusters = [{"cluster": number, "category": "dining table"} for number in range(12)]
    rows = pen.rows(clusters, SHEET_SIDE)
    assert len(rows) > 1
    assert [entry[0] for row in rows for _, entry in row][:12] == [f"{n} dining table" for n in range(12)]
    assert pen.strip_height(rows) > pen.strip_height(rows[:1])
    image = Image.new("RGB", (SHEET_SIDE, pen.strip_height(rows)), (255, 255, 255))
    from PIL import ImageDraw

    pen.strip(ImageDraw.Draw(image), rows, 0)
    drawn = (np.asarray(image) == INK).all(axis=-1)
    assert drawn.any()
    assert not drawn[:, -2:].any()


def test_scene_map_without_views_is_an_input_error(balls: Path) -> None:
    from dataclasses import replace

    scene = replace(load_scene(str(balls)), views=())
    with pytest.raises(InputError, match="eye level"):
        scene_map(SceneContext(scene))


def test_render_map_and_question_are_files_to_look_at(balls: Path, balls_run: str, tmp_path: Path) -> None:
    asked = ["render", str(balls), "--map", "--run", balls_run, "--question", "one/ball", "--sheet"]
    told = CliRunner().invoke(app, [*asked, "--output", str(tmp_path)])
    assert told.exit_code == 0, told.output
    names = {path.name for path in tmp_path.iterdir()}
    assert {"map.png", "sheet.png", "grounded-front.png"} <= names
    assert f"{len(names)} files" in told.output
    views = sorted(name for name in names if name.startswith("view-"))
    assert views[0] == "view-0-cluster-0-initial.png"
    assert len(views) == len(RunScene(balls_run, str(balls)).to_draw("one/ball").candidates)
    for name in names:
        assert np.asarray(Image.open(tmp_path / name)).std() > 5, name


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"run": "somewhere"}, "both or neither"),
        ({"question": "q"}, "both or neither"),
        ({"from_above": True, "camera": ["front"]}, "no --map"),
    ],
)
def test_render_options_that_contradict_each_other_are_input_errors(
    changes: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        render("scene", tmp_path, **changes)  # type: ignore[arg-type]


def test_run_scene_tells_questions_targets_and_what_is_wrong(balls: Path, balls_run: str, tmp_path: Path) -> None:
    found = RunScene(balls_run, str(balls))
    assert list(found.questions) == ["one/ball", "count"]
    asked = found.questions["one/ball"]
    assert (asked.text, asked.task, asked.status) == (HOSTILE, "ground_one", "answered")
    assert found.questions["count"].reference == "2"
    assert found.to_draw("one/ball").targets == (1,)
    with pytest.raises(InputError, match=r"--question.*one/ball, count, found nope"):
        found.to_draw("nope")
    other = save_balls(tmp_path)
    (other / "more.txt").write_text("new")
    with pytest.raises(InputError, match="scenes of other content: balls"):
        RunScene(balls_run, str(other))
    with pytest.raises(InputError, match="run folder"):
        RunScene(str(tmp_path), str(balls))
