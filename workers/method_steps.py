"""The real method behind the seam of `steps.py`. Imports wait until a step runs: the driver needs none of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schemas.questions import Question
from schemas.run_folder import image_name
from schemas.tables import TABLES
from workers import index_steps
from workers.steps import Steps, Tables, Work

if TYPE_CHECKING:
    from pipeline.config import MethodConfig
    from pipeline.models.caller import Caller
    from pipeline.models.gate import Gate
    from pipeline.render import PreparedGaussians
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


def prepare(scene: Scene) -> PreparedGaussians:
    """Return the Gaussians prepared for rendering, without their colours, which lie in the scene already."""
    from pipeline.render import prepare

    return replace(prepare(scene.gaussians), sh=scene.gaussians.sh[:0])


def open_context(scene: Scene, prepared: PreparedGaussians | None) -> SceneContext:
    """Return the caches of a scene; nothing is computed yet."""
    from pipeline.tasks.method import SceneContext

    context = SceneContext(scene)
    if prepared is not None:
        context.gaussians = replace(prepared, sh=scene.gaussians.sh)
    return context


def make_caller(work: Work, gates: Mapping[str, Gate]) -> Caller:
    """Return who asks the models."""
    from pipeline.models.clients import make_caller

    cache = None if work.cache == "off" else Path(work.calls)
    return make_caller(work.models, cache, gates, replay=work.cache == "replay")


async def close_caller(caller: Caller) -> None:
    """Close a caller's connections."""
    await caller.aclose()


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
    prepare=prepare,
    open_context=open_context,
    read_index=index_steps.read_index,
    adopt_rows=index_steps.adopt_rows,
    keep_rows=index_steps.keep_rows,
    index_views=index_steps.index_views,
    join_index=index_steps.join_index,
    adopt_index=index_steps.adopt_index,
    make_caller=make_caller,
    close_caller=close_caller,
    find_evidence=find_evidence,
    propose=propose,
    decide=decide,
    conclude=conclude,
    thumbnails=thumbnails,
    tables=tables,
    failed_rows=failed_rows,
)
"""The paper's method."""
