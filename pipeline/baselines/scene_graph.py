"""A scene graph in text: each object cut out of its best view and described, with its place and its neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.baselines.boxes import object_box, place_notes
from pipeline.baselines.captions import answer_notes, describe
from pipeline.baselines.config import SceneGraphConfig
from pipeline.baselines.material import Material
from pipeline.baselines.once import once
from pipeline.baselines.scene_objects import objects_index, scene_objects
from pipeline.baselines.steps import BaselineSteps
from pipeline.models.caller import Caller
from pipeline.models.messages import ImagePart
from pipeline.query.candidates import Picture
from pipeline.query.evidence import Evidence
from pipeline.query.initial_views import by_visible_size
from pipeline.query.stopwatch import Stopwatch
from pipeline.tasks.context import FoundCluster, SceneContext
from pipeline.tasks.task_answer import TaskAnswer
from schemas.calls import CallRow
from schemas.questions import Question

LEAST_SIDE = 32
"""Smallest side of a cut-out, pixels: less shows a model nothing."""
TRIM = 2.0
"""Percent of an object's pixels, by Gaussian, that may lie outside on each side before the margin."""


def cut_out(picture: Picture, found: FoundCluster, margin: float) -> ImagePart:
    """Return the part of a picture around an object that it shows; the whole picture where it shows none of it.

    Args:
        picture: Its best view.
        found: The object.
        margin: What is shown around it, as a share of its size.
    """
    image, shown = picture.image, picture.footprint
    mine = np.isin(shown.ids, found.ids)
    if not mine.any():
        return image
    centres = shown.sums[mine] / shown.pixels[mine, None]
    low, high = np.percentile(centres, [TRIM, 100.0 - TRIM], axis=0)
    sides = np.maximum((1.0 + 2.0 * margin) * (high - low), LEAST_SIDE)
    limit = np.array([shown.width, shown.height])
    first = np.clip(np.floor(0.5 * (low + high - sides)), 0, limit - 1).astype(int)
    last = np.clip(np.ceil(0.5 * (low + high + sides)), first + 1, limit).astype(int)
    columns, rows = slice(first[0], last[0]), slice(first[1], last[1])
    seen = image.observation
    if seen is not None:
        K = seen.K.copy()
        K[:2, 2] -= first
        seen = replace(seen, category=seen.category[rows, columns], depth=seen.depth[rows, columns], K=K)
    return ImagePart(np.ascontiguousarray(image.color[rows, columns]), seen)


def _gather(
    context: SceneContext, question: Question, evidence: Evidence, config: SceneGraphConfig, watch: Stopwatch
) -> Material:
    return once(context, config, lambda: _graph(context, config, watch))


def _graph(context: SceneContext, config: SceneGraphConfig, watch: Stopwatch) -> Material:
    found = scene_objects(context, config.objects, watch)
    order = by_visible_size(tuple(one.initial for one in found))
    kept = [found[position] for position in order if found[position].initial.view is not None][: config.max_objects]
    views = [context.scene.views[one.initial.view or 0] for one in kept]
    with watch.stage("render", len({view.name for view in views})):
        book = context.pictures(config.images())
        cuts = tuple(
            cut_out(book.render(view.camera, view), one, config.margin) for one, view in zip(kept, views, strict=True)
        )
    with watch.stage("relations", len(kept)):
        notes = tuple(place_notes([object_box(context.scene, one.category, one.ids) for one in kept]))
    return Material(
        pictures=cuts,
        names=tuple(f"{view.name}/{number}" for number, view in enumerate(views)),
        labels=tuple(one.category for one in kept),
        notes=notes,
        activated=sum(len(one.ids) for one in found),
        objects=len(kept),
    )


async def _answer(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> TaskAnswer:
    captions = await describe(question, material, caller, calls)
    notes = [
        f"Object {number}: {caption or f'There is a {label}.'} {place}"
        for number, (caption, label, place) in enumerate(zip(captions, material.labels, material.notes, strict=True))
    ]
    return await answer_notes(question, notes, "objects", caller, calls)


SCENE_GRAPH_CAPTIONS = BaselineSteps("scene_graph_captions", "eqa", _gather, _answer, reads_index=objects_index)
"""OpenEQA's ConceptGraphs captions, from our clusters."""
