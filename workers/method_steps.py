"""The real method behind the seam of `steps.py`. Imports wait until a step runs: the driver needs none of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int32, Int64

from schemas.questions import Question
from schemas.run_folder import image_name
from schemas.tables import TABLES
from workers.steps import Steps, Tables, Work

if TYPE_CHECKING:
    from pipeline.config import MethodConfig
    from pipeline.models.caller import Caller
    from pipeline.scene.scene import Scene
    from pipeline.tasks.method import Decision, Evidence, Proposal, QuestionRows, SceneContext


def load(uri: str) -> Scene:
    """Return the scene at a URI."""
    from pipeline.scene.load import load_scene

    return load_scene(uri)


def vocabulary(scene: Scene) -> tuple[str, ...]:
    """Return the category names a scene offers as evidence."""
    from pipeline.tasks.method import scene_vocabulary

    return scene_vocabulary(scene)


def open_context(scene: Scene) -> SceneContext:
    """Return the caches of a scene; nothing is computed yet."""
    from pipeline.tasks.method import SceneContext

    return SceneContext(scene)


@dataclass(frozen=True, slots=True)
class IndexPart:
    """Rows of the visibility index, in three arrays: many small ones would cost more to pass on than to use."""

    views: Int32[np.ndarray, "n"]
    """Views, numbered as in the scene."""
    starts: Int64[np.ndarray, "n+1"]
    """Where the ids of each view begin."""
    ids: Int32[np.ndarray, "_"]
    """Dominant Gaussians of all these views."""


def index_views(context: SceneContext, config: MethodConfig, part: int, parts: int) -> tuple[IndexPart, int]:
    """Return every `parts`-th row of the visibility index, from row `part` on, and the number of rows."""
    index = context.index(config.visibility)
    views = np.arange(part, len(index), parts, dtype=np.int32)
    rows = [index.ids(int(view)) for view in views]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in rows], dtype=np.int64)])
    return IndexPart(views, starts, np.concatenate([np.empty(0, np.int32), *rows])), len(views)


def adopt_index(context: SceneContext, config: MethodConfig, part: IndexPart) -> None:
    """Take over rows of the visibility index that another process computed."""
    index = context.index(config.visibility)
    for view, start, end in zip(part.views, part.starts[:-1], part.starts[1:], strict=True):
        index.adopt(int(view), part.ids[start:end])


def make_caller(work: Work) -> Caller:
    """Return who asks the models."""
    from pipeline.models.config import make_caller

    return make_caller(work.models, Path(work.calls))


async def find_evidence(
    question: Question, vocabulary: tuple[str, ...], caller: Caller, config: MethodConfig
) -> Evidence:
    """Return a question's evidence categories."""
    from pipeline.tasks.method import find_evidence

    return await find_evidence(question, vocabulary, caller, config)


def propose(context: SceneContext, question: Question, evidence: Evidence, config: MethodConfig) -> Proposal:
    """Return a question's candidate views."""
    from pipeline.tasks.method import propose

    return propose(context, question, evidence, config)


async def decide(question: Question, proposal: Proposal, caller: Caller, config: MethodConfig) -> Decision:
    """Return what the models decided."""
    from pipeline.tasks.method import decide

    return await decide(question, proposal, caller, config)


def conclude(
    context: SceneContext,
    question: Question,
    evidence: Evidence,
    proposal: Proposal,
    decision: Decision,
    config: MethodConfig,
) -> QuestionRows:
    """Return a question's rows."""
    from pipeline.tasks.method import conclude

    return conclude(context, question, evidence, proposal, decision, config)


def thumbnails(proposal: Proposal, rows: QuestionRows) -> Mapping[str, Any]:
    """Return the pictures of all candidate views by their path below the run folder."""
    pictures = {
        (group.cluster, candidate.id): proposal.pictures[candidate.picture].color
        for group in proposal.groups
        for candidate in group.candidates
    }
    return {
        image_name(row.scene, row.candidate, row.world_to_camera): pictures[row.cluster, row.candidate]
        for row in rows.candidates
    }


def tables(rows: QuestionRows) -> Tables:
    """Return a question's records by table."""
    return {name: getattr(rows, name) for name in TABLES}


def failed_rows(question: Question, error: Exception) -> QuestionRows:
    """Return the rows of a question that ended in an error."""
    from pipeline.models.caller import rows_of
    from pipeline.tasks.method import failed_rows

    return failed_rows(question, error, rows_of(error))


METHOD_STEPS = Steps(
    load=load,
    vocabulary=vocabulary,
    open_context=open_context,
    index_views=index_views,
    adopt_index=adopt_index,
    make_caller=make_caller,
    find_evidence=find_evidence,
    propose=propose,
    decide=decide,
    conclude=conclude,
    thumbnails=thumbnails,
    tables=tables,
    failed_rows=failed_rows,
)
"""The paper's method."""
