"""A language model that is told the question alone: what knowledge of homes gives without a look."""

from __future__ import annotations

from pipeline.baselines.config import BlindConfig
from pipeline.baselines.material import Material
from pipeline.baselines.rows import ARM
from pipeline.baselines.steps import BaselineSteps
from pipeline.models.caller import Caller
from pipeline.models.replies import parse_text
from pipeline.query.ask_all import ask_all
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import Stopwatch
from pipeline.tasks.context import SceneContext
from pipeline.tasks.task_answer import TaskAnswer, unreadable
from schemas.calls import CallRow
from schemas.questions import Question


def _gather(
    context: SceneContext, question: Question, evidence: Evidence, config: BlindConfig, watch: Stopwatch
) -> Material:
    return Material()


async def _answer(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> TaskAnswer:
    variables = {"question": question.question}
    ask = caller.ask("answer_blind", variables, (), parse_text, question=question, subject=ARM)
    text = (await ask_all([ask], calls))[0]
    return unreadable(ARM) if text is None else TaskAnswer("answered", "", text, ())


BLIND = BaselineSteps("blind", "eqa", _gather, _answer)
"""OpenEQA's blind language model."""
