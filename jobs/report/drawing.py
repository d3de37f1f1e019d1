"""Pictures of questions for a page: what `jobs.drawing` makes of them, as files that the page links."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import UInt8

from jobs.drawing.map_frame import frame_of
from jobs.drawing.overlays import overlay
from jobs.drawing.question import LARGE, Ids, QuestionArtist, method_of
from jobs.drawing.to_draw import ToDraw
from jobs.drawing.top_down import map_labels, map_picture
from jobs.report.shards import DataFolder
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext

SMALL = 256
"""Longest side of novel views' thumbnails, pixels."""
QUALITY = 82


@dataclass(frozen=True, slots=True)
class DrawnScene:
    """Plain data for the page; paths are as the page links them."""

    map: dict[str, Any]
    """Frame, picture and path of the recorded cameras."""
    questions: dict[str, dict[str, Any]]
    """By question: `views` ("cluster/candidate" to image and overlay), `dots` and `grounded`."""


def draw_scene(
    uri: str,
    method: Mapping[str, Any],
    wanted: Sequence[ToDraw],
    folder: DataFolder,
    *,
    threads: int,
    goes_on: Callable[[], bool],
) -> DrawnScene:
    """Return the pictures of some questions of one scene, after writing them.

    Args:
        uri: Scene.
        method: The job's method.
        wanted: Its questions.
        folder: Where pictures go.
        threads: Questions drawn side by side.
        goes_on: Called before a question is drawn; False leaves it and what follows out.

    Raises:
        InputError: The scene cannot be read, or the method is one of another version.
        RetryError: A remote store failed to answer.
    """
    config = method_of(method)
    scene = load_scene(uri)
    context = SceneContext(scene)
    stands = np.array([view.camera.center for view in scene.views])
    up = np.asarray(scene.up, np.float64)
    frame = frame_of(up, scene.gaussians.means, stands)
    picture = folder.picture(_webp(map_picture(context.gaussians, frame, up, stands)), "webp")
    artist = QuestionArtist(context, config)
    # Clusters are kept by the context, which is not for several threads.
    groups = [artist.clusters(question) for question in wanted]

    def draw(question: ToDraw, own: Mapping[int, Ids]) -> dict[str, Any] | None:
        if not goes_on():
            return None
        drawn: dict[str, Any] = {
            "views": _views(artist, question, own, folder),
            "grounded": _grounded(artist, question, folder),
        }
        if own:
            dots = overlay(map_labels(frame, scene.gaussians.means, own))
            drawn["dots"] = folder.picture(dots, "png")
        return drawn

    with ThreadPoolExecutor(threads) as pool:
        drawn = pool.map(draw, wanted, groups)
        found = {question.question_id: one for question, one in zip(wanted, drawn, strict=True) if one is not None}
    path = [[round(float(value), 2) for value in place] for place in frame.at(stands)]
    return DrawnScene({**frame.as_data(), "image": picture, "path": path}, found)


def _views(
    artist: QuestionArtist, question: ToDraw, groups: Mapping[int, Ids], folder: DataFolder
) -> dict[str, dict[str, Any]]:
    found = {}
    for row in question.candidates:
        number = int(row["cluster"])
        drawn = None
        if number in groups:
            drawn = artist.view(question, row, groups, LARGE if row["move"] == "initial" else SMALL)
        if drawn is None:
            continue
        shown: dict[str, Any] = {"image": folder.picture(_jpeg(drawn.color), "jpg")}
        if drawn.overlay is not None:
            shown["overlay"] = folder.picture(drawn.overlay, "png")
        height, width = drawn.color.shape[:2]
        found[f"{number}/{row['candidate']}"] = {**shown, "pixels": drawn.pixels, "of": width * height}
    return found


def _grounded(artist: QuestionArtist, question: ToDraw, folder: DataFolder) -> list[dict[str, Any]]:
    return [
        {
            "view": drawn.view,
            "image": folder.picture(_jpeg(drawn.color), "jpg"),
            "overlay": folder.picture(drawn.overlay, "png"),
            "instances": [[number, count] for number, count in drawn.instances.items()],
            "truth": drawn.truth,
        }
        for drawn in artist.grounded(question)
    ]


def _jpeg(color: UInt8[np.ndarray, "H W 3"]) -> bytes:
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(color).save(sink, "JPEG", quality=QUALITY, optimize=True)
    return sink.getvalue()


def _webp(color: UInt8[np.ndarray, "H W 4"]) -> bytes:
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(color, "RGBA").save(sink, "WEBP", quality=QUALITY)
    return sink.getvalue()
