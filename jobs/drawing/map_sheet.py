"""A scene from above as one picture to keep: the path of its cameras, clusters, initial, novel and chosen views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from jobs.drawing.map_frame import LONG_SIDE, MapFrame, frame_of
from jobs.drawing.map_pen import PAPER, MapPen
from jobs.drawing.overlays import laid_over, overlay
from jobs.drawing.question import Ids
from jobs.drawing.to_draw import ToDraw
from jobs.drawing.top_down import map_labels, map_picture
from pipeline.scene.scene import Scene
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError

SHEET_SIDE = 2 * LONG_SIDE
"""Pixels of the longer side of the map."""


@dataclass(frozen=True, slots=True)
class SceneMap:
    """A map without anything on it."""

    frame: MapFrame
    """What it shows."""
    picture: UInt8[np.ndarray, "H W 3"]
    """The scene below eye level, on white."""
    path: Float[np.ndarray, "N 2"]
    """Where the recorded cameras stand, in order, metres on the map."""


def scene_map(context: SceneContext, threads: int = 1) -> SceneMap:
    """Return the map of a scene.

    Raises:
        InputError: The scene has no recorded view, so that eye level is unknown.
    """
    scene: Scene = context.scene
    if not scene.views:
        raise InputError(scene.name, field="views", expected="a recorded view, which tells eye level", found="none")
    up, stands = np.asarray(scene.up, np.float64), np.array([view.camera.center for view in scene.views])
    frame = frame_of(up, scene.gaussians.means, stands)
    seen = map_picture(context.gaussians, frame, up, stands, SHEET_SIDE, threads)
    # Colours are on black already: what is clear shows the paper.
    paper = np.array(PAPER) * (1.0 - seen[..., 3:] / 255.0)
    picture = np.clip(np.rint(seen[..., :3] + paper), 0, 255).astype(np.uint8)
    return SceneMap(frame, picture, frame.at(stands))


def map_sheet(
    base: SceneMap,
    means: Float[np.ndarray, "M 3"],
    question: ToDraw | None = None,
    groups: Mapping[int, Ids] | None = None,
) -> UInt8[np.ndarray, "H W 3"]:
    """Return the map with its path, a scale, and what a question found.

    Args:
        base: The map.
        means: Centres of all Gaussians, metres.
        question: Its clusters and views are drawn; None for the scene alone.
        groups: Gaussians of its clusters by number, as far as they are known.
    """
    from PIL import Image, ImageDraw

    color = base.picture
    if groups:
        color = laid_over(color, [overlay(map_labels(base.frame, means, groups, SHEET_SIDE))])
    height, width = color.shape[:2]
    pen = MapPen(base.frame, SHEET_SIDE)
    rows = pen.rows([] if question is None else question.clusters, width)
    whole = Image.new("RGB", (width, height + pen.strip_height(rows)), PAPER)
    whole.paste(Image.fromarray(color))
    draw = ImageDraw.Draw(whole)
    pen.path(draw, base.path)
    if question is not None:
        for row in sorted(question.candidates, key=lambda row: bool(row["chosen"])):
            pen.wedge(draw, row)
        for row in question.clusters:
            pen.centre(draw, row)
    pen.strip(draw, rows, height)
    return np.asarray(whole)
