"""The method as the steps that workers run: find_evidence, propose, decide, conclude. Knows nothing of where they run.

find_evidence and decide wait for models; propose and conclude compute. What passes between them is picklable.
"""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.config import MethodConfig
from pipeline.models.caller import Caller
from pipeline.query import evidence as evidence_stage
from pipeline.query.evidence import Evidence
from pipeline.tasks.conclude import conclude
from pipeline.tasks.context import SceneContext, scene_vocabulary
from pipeline.tasks.decision import Decision, decide
from pipeline.tasks.proposal import Proposal, propose
from pipeline.tasks.rows import QuestionRows, failed_rows
from schemas.questions import Question

__all__ = [
    "Decision",
    "Evidence",
    "Proposal",
    "QuestionRows",
    "SceneContext",
    "conclude",
    "decide",
    "failed_rows",
    "find_evidence",
    "propose",
    "scene_vocabulary",
]


async def find_evidence(
    question: Question, vocabulary: Sequence[str], caller: Caller, config: MethodConfig
) -> Evidence:
    """Return the evidence categories of a question.

    Args:
        question: The query.
        vocabulary: `scene_vocabulary` of its scene.
        caller: Sends the call.
        config: The method's.

    Raises:
        RetryError: The endpoint failed for a reason that may pass.
        StopError: No call can succeed.
    """
    return await evidence_stage.find_evidence(question, vocabulary, caller, config.evidence)
