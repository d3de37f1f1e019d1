"""Evenly spaced views: described one by one (frame captions), or shown as they are (multi-frame)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.baselines.captions import answer_notes, describe
from pipeline.baselines.config import FrameCaptionsConfig, MultiFrameConfig, Shown
from pipeline.baselines.material import Material
from pipeline.baselines.rows import ARM
from pipeline.baselines.steps import BaselineSteps
from pipeline.models.caller import Caller
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import Stopwatch
from pipeline.tasks.context import SceneContext
from pipeline.tasks.eqa import answer_eqa
from pipeline.tasks.task_answer import TaskAnswer
from schemas.calls import CallRow
from schemas.questions import Question


def even_frames(count: int, wanted: int) -> tuple[int, ...]:
    """Return the numbers of evenly spaced views, the first and the last among them; all where there are fewer.

    OpenEQA's rule: round(linspace(0, n - 1, K)).

    Args:
        count: N, at least 1.
        wanted: K, at least 1.
    """
    return tuple(dict.fromkeys(np.rint(np.linspace(0, count - 1, wanted)).astype(int).tolist()))


def shown_views(context: SceneContext, views: Sequence[int], config: Shown, watch: Stopwatch) -> Material:
    """Return the pictures of recorded views.

    Args:
        context: The scene's caches.
        views: Numbers of the views.
        config: How they are shown.
        watch: Where seconds are kept.

    Raises:
        InputError: A photograph cannot be read.
    """
    chosen = [context.scene.views[view] for view in views]
    with watch.stage("render", len(chosen)):
        pictures = context.pictures(config.images()).render_all([view.camera for view in chosen], chosen)
    return Material(pictures=tuple(picture.image for picture in pictures), names=tuple(view.name for view in chosen))


def _gather(
    context: SceneContext,
    question: Question,
    evidence: Evidence,
    config: FrameCaptionsConfig | MultiFrameConfig,
    watch: Stopwatch,
) -> Material:
    return shown_views(context, even_frames(len(context.scene.views), config.frames), config, watch)


async def answer_frames(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> TaskAnswer:
    """Return the answer of a model that sees all pictures."""
    return await answer_eqa(question, material.pictures, ARM, caller, calls)


async def _answer_captions(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> TaskAnswer:
    captions = await describe(question, material, caller, calls)
    notes = [caption for caption in captions if caption is not None]
    return await answer_notes(question, notes, "pictures", caller, calls)


FRAME_CAPTIONS = BaselineSteps("frame_captions", "eqa", _gather, _answer_captions)
"""OpenEQA's Socratic models with frame captions."""
MULTI_FRAME = BaselineSteps("multi_frame", "eqa", _gather, answer_frames, shows=True)
"""OpenEQA's multi-frame models."""
