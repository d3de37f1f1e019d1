"""The frame that all baselines share: a baseline says what it gathers and how it answers, the rest is here.

Every baseline has one arm, `final`.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from pipeline.baselines.material import Material, nothing
from pipeline.baselines.method_steps import MethodSteps
from pipeline.baselines.rows import ARM, conclude, failed_rows
from pipeline.models.caller import Caller
from pipeline.query import evidence as evidence_stage
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import Stopwatch
from pipeline.query.visibility import VisibilityConfig
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Arm, Decision
from pipeline.tasks.marks import Mark, mark_answers
from pipeline.tasks.rows import QuestionRows
from pipeline.tasks.task_answer import TaskAnswer
from schemas.calls import CallRow
from schemas.errors import QuestionError
from schemas.questions import Question

Gather = Callable[[SceneContext, Question, Evidence, Any, Stopwatch], Material]
Answer = Callable[[Question, Material, Caller, list[CallRow]], Awaitable[TaskAnswer]]

NO_EVIDENCE = Evidence("answered", "", (), (), 0.0)
"""Evidence of a baseline that asks for none."""


@dataclass(frozen=True, slots=True)
class BaselineSteps:
    """One baseline."""

    kind: str
    """Its name in job files and rows."""
    does: Literal["eqa", "grounding"]
    """Which questions it answers; the others are skipped with a reason."""
    gather: Gather
    """Context, question, evidence, config and stopwatch to material; CPU only."""
    answer: Answer
    """Question, material, caller and the list of its calls' rows to an answer."""
    shows: bool = False
    """Whether the model that answers sees the pictures; else they are only described."""
    asks_evidence: bool = False
    """Whether it starts from evidence categories."""
    reads_index: Callable[[Any], VisibilityConfig | None] = lambda config: None
    """Config to that of the visibility index it reads."""

    def as_method(self) -> MethodSteps:
        """Return the steps a runner calls."""
        return MethodSteps(
            self.find_evidence, self.propose, self.decide, self.conclude, self.failed_rows, self.reads_index
        )

    async def find_evidence(
        self, question: Question, vocabulary: Sequence[str], caller: Caller, config: Any
    ) -> Evidence:
        """Return the evidence categories, or that the question is of a task that the baseline does not do."""
        if (question.task == "eqa") != (self.does == "eqa"):
            does = "answers in words" if self.does == "eqa" else "grounds in 3D"
            return Evidence("skipped", f"{self.kind} only {does}", (), (), 0.0)
        if not self.asks_evidence:
            return NO_EVIDENCE
        return await evidence_stage.find_evidence(question, vocabulary, caller, config.evidence)

    def propose(self, context: SceneContext, question: Question, evidence: Evidence, config: Any) -> Material:
        """Return what the question is answered from."""
        if evidence.status == "answered":
            watch = Stopwatch()
            material = self.gather(context, question, evidence, config, watch)
            return replace(material, categories=evidence.categories, times=watch.times())
        if evidence.status == "skipped" and evidence.calls and question.task == "ground_many":
            # The model was asked and named none of the scene's categories: zero targets is an answer of this task.
            return Material(reason=f"no target: {evidence.reason}")
        return nothing(evidence)

    async def decide(self, question: Question, material: Material, caller: Caller, config: Any) -> Decision:
        """Return the answer and its mark."""
        calls: list[CallRow] = []
        watch = Stopwatch()
        if material.status != "answered":
            return self._decision(TaskAnswer(material.status, material.reason, "", ()), material, calls, watch)
        try:
            with watch.stage("answer", 1):
                result = await self.answer(question, material, caller, calls)
            mark = await _marked(question, result, caller, config, calls, watch)
        except QuestionError as error:
            failed = TaskAnswer("failed", f"{type(error).__name__}: {error}", "", ())
            return self._decision(failed, material, calls, watch)
        return self._decision(result, material, calls, watch, mark)

    def _decision(
        self,
        result: TaskAnswer,
        material: Material,
        calls: list[CallRow],
        watch: Stopwatch,
        mark: Mark | None = None,
    ) -> Decision:
        mark = mark or Mark(None, f"{result.status}: {result.reason}")
        shown = tuple(range(len(material.pictures))) if self.shows else ()
        return Decision((), (), (Arm(ARM, result, shown, mark),), "", tuple(calls), watch.times())

    def conclude(
        self,
        context: SceneContext,
        question: Question,
        evidence: Evidence,
        material: Material,
        decision: Decision,
        config: Any,
    ) -> QuestionRows:
        """Return the rows of every table."""
        return conclude(context, question, evidence, material, decision, config)

    def failed_rows(self, question: Question, error: Exception, calls: tuple[CallRow, ...] = ()) -> QuestionRows:
        """Return the rows of a question that ended in an error."""
        return failed_rows(self.kind, question, error, calls)


async def _marked(
    question: Question, result: TaskAnswer, caller: Caller, config: Any, calls: list[CallRow], watch: Stopwatch
) -> Mark:
    if not config.mark or question.answer is None:
        return Mark(None, "no reference answer" if question.answer is None else "marks are off")
    if result.status != "answered":
        return Mark(None, f"{result.status}: {result.reason}")
    with watch.stage("judge", 1):
        return (await mark_answers(question, [result.text], [ARM], caller, calls, None))[0]
