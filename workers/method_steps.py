"""The real methods behind the seam of `steps.py`. Imports wait until a step runs: the driver needs none of them.

Which method runs is a matter of its config: `pipeline.baselines.registry` has the steps of each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schemas.questions import Question
from schemas.run_folder import image_name
from schemas.tables import TABLES
from workers import index_steps
from workers.steps import Steps, Tables, Work

if TYPE_CHECKING:
    from pipeline.baselines.config import AnyMethod
    from pipeline.config import MethodConfig
    from pipeline.models.caller import Caller
    from pipeline.models.gate import Gate
    from pipeline.query.transposed import Transposed
    from pipeline.render import PreparedGaussians
    from pipeline.scene.scene import Scene
    from pipeline.tasks.method import Decision, Evidence, QuestionRows, SceneContext
    from workers.index_steps import FoundIndex, IndexPart, Unstored


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


async def find_evidence(question: Question, vocabulary: tuple[str, ...], caller: Caller, config: AnyMethod) -> Evidence:
    """Return a question's evidence categories."""
    from pipeline.baselines.registry import steps_of

    return await steps_of(config).find_evidence(question, vocabulary, caller, config)


def propose(context: SceneContext, question: Question, evidence: Evidence, config: AnyMethod) -> Any:
    """Return a question's candidate views, or what else its method answers from."""
    from pipeline.baselines.registry import steps_of

    return steps_of(config).propose(context, question, evidence, config)


async def decide(question: Question, proposal: Any, caller: Caller, config: AnyMethod) -> Decision:
    """Return what the models decided."""
    from pipeline.baselines.registry import steps_of

    return await steps_of(config).decide(question, proposal, caller, config)


def conclude(
    context: SceneContext,
    question: Question,
    evidence: Evidence,
    proposal: Any,
    decision: Decision,
    config: AnyMethod,
) -> QuestionRows:
    """Return a question's rows."""
    from pipeline.baselines.registry import steps_of

    return steps_of(config).conclude(context, question, evidence, proposal, decision, config)


def thumbnails(proposal: Any, rows: QuestionRows) -> Mapping[str, Any]:
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


def failed_rows(question: Question, error: Exception, config: AnyMethod) -> QuestionRows:
    """Return the rows of a question that ended in an error."""
    from pipeline.baselines.registry import steps_of
    from pipeline.models.caller import rows_of

    return steps_of(config).failed_rows(question, error, rows_of(error))


def read_index(scene: Scene, config: AnyMethod, folder: str) -> FoundIndex:
    """Return what lies on disk of a scene's index; nothing for a method that reads none."""
    method = _indexed(config)
    return index_steps.NO_INDEX if method is None else index_steps.read_index(scene, method, folder)


def adopt_rows(context: SceneContext, config: AnyMethod, rows: Mapping[int, Any]) -> None:
    """Take over rows of the index."""
    if (method := _indexed(config)) is not None:
        index_steps.adopt_rows(context, method, rows)


def keep_rows(context: SceneContext, config: AnyMethod, unstored: Unstored) -> int:
    """Store the rows that this context has rendered since; return how many."""
    method = _indexed(config)
    return 0 if method is None else index_steps.keep_rows(context, method, unstored)


def index_views(context: SceneContext, config: AnyMethod, unstored: Unstored, part: int, parts: int) -> IndexPart:
    """Render and store a part of the missing views."""
    method = _indexed(config)
    empty = index_steps.IndexPart.of({})
    return empty if method is None else index_steps.index_views(context, method, unstored, part, parts)


def join_index(scene: Scene, config: AnyMethod, parts: Sequence[IndexPart]) -> Transposed | IndexPart:
    """Return all rows of the index."""
    method = _indexed(config)
    return index_steps.IndexPart.of({}) if method is None else index_steps.join_index(scene, method, parts)


def adopt_index(context: SceneContext, config: AnyMethod, joined: Transposed | IndexPart) -> None:
    """Take over the index."""
    if (method := _indexed(config)) is not None:
        index_steps.adopt_index(context, method, joined)


@lru_cache(maxsize=16)
def _indexed(config: AnyMethod) -> MethodConfig | None:
    """Return a config with the settings of the visibility index that a method reads; None where it reads none."""
    from pipeline.baselines.registry import steps_of
    from pipeline.config import MethodConfig

    visibility = steps_of(config).visibility(config)
    return None if visibility is None else MethodConfig(visibility=visibility)


METHOD_STEPS = Steps(
    load=load,
    vocabulary=vocabulary,
    prepare=prepare,
    open_context=open_context,
    read_index=read_index,
    adopt_rows=adopt_rows,
    keep_rows=keep_rows,
    index_views=index_views,
    join_index=join_index,
    adopt_index=adopt_index,
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
"""The paper's method and the baselines."""
