"""Pictures of questions from their scene's files: which Gaussians were found, seen and grounded, and where.

Clusters are found again as the run found them; one that does not come out the same is left out.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int32, UInt8
from pydantic import ValidationError

from jobs.report.overlays import groups_image, overlay
from jobs.report.shards import DataFolder
from jobs.report.to_draw import ToDraw
from jobs.report.top_down import LONG_SIDE, MapFrame, frame_of, map_picture
from pipeline.config import MethodConfig
from pipeline.geometry import Camera
from pipeline.query.candidates import read_photo
from pipeline.query.visibility import fitted_to
from pipeline.render import color_image, render
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError

LARGE, SMALL = 512, 256
"""Longest side, pixels: of initial views and groundings, which are drawn anew, and of novel views' thumbnails."""
QUALITY = 82
SAME_CENTRE_M = 1e-4
"""Centres of a cluster found again differ by rounding alone."""
Ids = Int32[np.ndarray, "_"]


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
    config = None
    if method.get("kind") == "splatreasoner":
        try:
            config = MethodConfig.model_validate(method)
        except ValidationError as error:
            raise InputError("the run's method", expected="fields of this version", found=str(error)) from error
    scene = load_scene(uri)
    context = SceneContext(scene)
    stands = np.array([view.camera.center for view in scene.views])
    up = np.asarray(scene.up, np.float64)
    frame = frame_of(up, scene.gaussians.means, stands)
    picture = folder.picture(_webp(map_picture(context.gaussians, frame, up, stands)), "webp")
    artist = _Artist(context, config or MethodConfig(), frame, folder)
    # Clusters are kept by the context, which is not for several threads.
    groups = [{} if config is None else artist.clusters(question) for question in wanted]
    with ThreadPoolExecutor(threads) as pool:
        drawn = pool.map(lambda question, own: artist.question(question, own) if goes_on() else None, wanted, groups)
        found = {question.question_id: one for question, one in zip(wanted, drawn, strict=True) if one is not None}
    path = [[round(float(value), 2) for value in place] for place in frame.at(stands)]
    return DrawnScene({**frame.as_data(), "image": picture, "path": path}, found)


class _Artist:
    """Draws the questions of one scene."""

    def __init__(self, context: SceneContext, config: MethodConfig, frame: MapFrame, folder: DataFolder) -> None:
        self._context, self._config, self._frame, self._folder = context, config, frame, folder
        self._views = {view.name: view for view in context.scene.views}
        self._count = len(context.scene.gaussians)
        self._gaussians = context.gaussians

    def clusters(self, question: ToDraw) -> dict[int, Ids]:
        """Return the Gaussians of the question's clusters by number; those that come out otherwise are left out."""
        means, found = self._context.scene.gaussians.means, {}
        for row in question.clusters:
            if row["category"] not in self._context.scene.semantics.vocabulary:
                continue
            for ids in self._context.clusters(row["category"], self._config):
                centre = means[ids].mean(axis=0, dtype=np.float64)
                if len(ids) == row["gaussians"] and np.abs(centre - np.array(row["centre"])).max() < SAME_CENTRE_M:
                    found[int(row["cluster"])] = ids
        return found

    def question(self, question: ToDraw, groups: Mapping[int, Ids]) -> dict[str, Any]:
        """Return the links of a question's pictures."""
        lenses = {int(row["cluster"]): str(row["initial_view"]) for row in question.clusters}
        views = {}
        for row in question.candidates:
            number = int(row["cluster"])
            camera = self._camera(lenses.get(number, ""), row["world_to_camera"])
            if camera is None or number not in groups:
                continue
            views[f"{number}/{row['candidate']}"] = self._view(row, camera, groups)
        drawn: dict[str, Any] = {"views": views, "grounded": self._grounded(question, lenses)}
        if groups:
            drawn["dots"] = self._dots(groups)
        return drawn

    def _view(self, row: Mapping[str, Any], camera: Camera, groups: Mapping[int, Ids]) -> dict[str, Any]:
        number, large = int(row["cluster"]), row["move"] == "initial"
        fitted = fitted_to(camera, LARGE if large else SMALL)
        seen = render(self._gaussians, fitted, ("color", "dominant"), near=self._config.images.near_m)
        assert seen.dominant is not None
        ordered = [groups.get(place, np.empty(0, np.int32)) for place in range(max(groups) + 1)]
        labels = groups_image(seen.dominant, ordered, self._count)
        color, view = color_image(seen), self._views.get(str(row["candidate"]))
        if row["source"] == "photo" and view is not None and view.image is not None:
            color = read_photo(view.image, fitted.width, fitted.height)
        shown = {"image": self._folder.picture(_jpeg(color), "jpg")}
        if labels.any():
            shown["overlay"] = self._folder.picture(overlay(labels, filled=number + 1), "png")
        return {**shown, "pixels": int((labels == number + 1).sum()), "of": int(labels.size)}

    def _grounded(self, question: ToDraw, lenses: Mapping[int, str]) -> list[dict[str, Any]]:
        poses = {str(row["candidate"]): row for row in question.candidates}
        truth = self._truth(question.targets)
        found = []
        for name in dict.fromkeys(str(row["view"]) for row in question.regions):
            pose = poses.get(name)
            if pose is None:
                camera = self._views[name].camera if name in self._views else None
            else:
                camera = self._camera(lenses.get(int(pose["cluster"]), ""), pose["world_to_camera"])
            if camera is None:
                continue
            seen = render(self._gaussians, fitted_to(camera, LARGE), ("color", "dominant"))
            assert seen.dominant is not None
            own = {
                int(row["instance"]): np.asarray(row["gaussians"], np.int32)
                for row in question.regions
                if row["view"] == name
            }
            ordered = [own.get(number, np.empty(0, np.int32)) for number in range(max(own) + 1)]
            labels = groups_image(seen.dominant, ordered, self._count)
            shown = None if truth is None else truth[seen.dominant]
            found.append(
                {
                    "view": name,
                    "image": self._folder.picture(_jpeg(color_image(seen)), "jpg"),
                    "overlay": self._folder.picture(overlay(labels, truth=shown), "png"),
                    "instances": [[number, len(ids)] for number, ids in own.items()],
                    "truth": None if shown is None else int(shown.sum()),
                }
            )
        return found

    def _truth(self, targets: tuple[int, ...]) -> Bool[np.ndarray, "_"] | None:
        """Which Gaussians are targets, with a False for -1 at the end; None where that is unknown."""
        instance = self._context.scene.semantics.instance
        if instance is None or not targets:
            return None
        return np.append(np.isin(instance, targets), False)

    def _camera(self, lens: str, pose: Sequence[float]) -> Camera | None:
        view = self._views.get(lens)
        return None if view is None else view.camera.moved_to(np.array(pose, np.float64).reshape(3, 4))

    def _dots(self, groups: Mapping[int, Ids]) -> str:
        """Draw the clusters on the map, larger ones first, so that small ones stay visible."""
        per_metre = LONG_SIDE / float(self._frame.size.max())
        width, height = (max(16, round(float(side) * per_metre)) for side in self._frame.size)
        labels = np.zeros((height, width), np.uint8)
        for number, ids in sorted(groups.items(), key=lambda item: -len(item[1])):
            places = (self._frame.at(self._context.scene.gaussians.means[ids]) * per_metre).astype(np.int64)
            for right in (-1, 0, 1):
                for down in (-1, 0, 1):
                    x, y = places[:, 0] + right, places[:, 1] + down
                    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
                    labels[y[inside], x[inside]] = number + 1
        return self._folder.picture(overlay(labels), "png")


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
