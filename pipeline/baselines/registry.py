"""Which steps a method's config calls for."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.baselines.blind import BLIND
from pipeline.baselines.config import AnyMethod
from pipeline.baselines.field import CATEGORY_FIELD, SCORES_FIELD, SENTENCE_FIELD
from pipeline.baselines.frames import FRAME_CAPTIONS, MULTI_FRAME
from pipeline.baselines.memory import MEMORY_SNAPSHOTS
from pipeline.baselines.method_steps import MethodSteps
from pipeline.baselines.scene_graph import SCENE_GRAPH_CAPTIONS
from pipeline.baselines.voxel_map import VOXEL_CAPTIONS
from pipeline.models.caller import Caller
from pipeline.tasks import method
from pipeline.tasks.method import QuestionRows, SceneContext
from pipeline.tasks.rows import METHOD
from schemas.questions import Question

_STEPS: Mapping[str, MethodSteps] = {
    METHOD: MethodSteps(
        method.find_evidence,
        method.propose,
        method.decide,
        method.conclude,
        method.failed_rows,
        lambda config: config.visibility,
    ),
    **{
        baseline.kind: baseline.as_method()
        for baseline in (
            BLIND,
            FRAME_CAPTIONS,
            SCENE_GRAPH_CAPTIONS,
            VOXEL_CAPTIONS,
            MULTI_FRAME,
            MEMORY_SNAPSHOTS,
            CATEGORY_FIELD,
            SENTENCE_FIELD,
            SCORES_FIELD,
        )
    },
}


def steps_of(config: AnyMethod) -> MethodSteps:
    """Return the steps of a method."""
    return _STEPS[config.kind]


async def answer_question(context: SceneContext, question: Question, caller: Caller, config: AnyMethod) -> QuestionRows:
    """Return the rows of one question by any method, all steps in this process.

    Args:
        context: The scene's caches.
        question: The query.
        caller: Sends the calls.
        config: The method's.

    Raises:
        RetryError: An endpoint failed for a reason that may pass.
        StopError: No call can succeed.
        InputError: The scene lacks what the method needs.
    """
    steps = steps_of(config)
    evidence = await steps.find_evidence(question, context.vocabulary, caller, config)
    proposal = steps.propose(context, question, evidence, config)
    decision = await steps.decide(question, proposal, caller, config)
    return steps.conclude(context, question, evidence, proposal, decision, config)
