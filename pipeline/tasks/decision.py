"""What the models decide on a proposal: chosen views, the answers of each arm, verification and marks."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pipeline.config import MethodConfig
from pipeline.models.caller import Caller
from pipeline.query.judge import WITHOUT_ANSWERS, Choice
from pipeline.query.savings import SAME_VIEWS, Saved, Savings
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.query.verify import FINAL, INITIAL, verify_answers
from pipeline.tasks.eqa import answer_eqa
from pipeline.tasks.ground_many import ground_many
from pipeline.tasks.ground_one import ground_one
from pipeline.tasks.marks import Mark, mark_answers
from pipeline.tasks.proposal import Proposal
from pipeline.tasks.task_answer import TaskAnswer
from pipeline.tasks.view_judging import ViewJudging
from schemas.answers import Status
from schemas.calls import CallRow
from schemas.errors import QuestionError
from schemas.questions import Question

ARMS = ("initial", "final", "verified")
"""Arms of the ablation, in the order of their rows."""


@dataclass(frozen=True, slots=True)
class Arm:
    """How one arm of the ablation answered."""

    name: str
    """initial, final or verified."""
    result: TaskAnswer
    """Status, text and chosen images."""
    pictures: tuple[int, ...]
    """Views given to the model, positions in `Proposal.pictures`."""
    mark: Mark
    """LLM-Match."""


@dataclass(frozen=True, slots=True)
class Decision:
    """All model output for a question."""

    view_answers: tuple[str | None, ...]
    """Answer from each picture alone; None where it was not asked or could not be read."""
    choices: tuple[int | None, ...]
    """Chosen candidate of each cluster with views, by `Proposal.seen`; None when it could not be read."""
    arms: tuple[Arm, ...]
    """initial, final and verified."""
    stands: str
    """What verification chose: initial, final, or mixed (per cluster); empty when there was nothing to verify."""
    calls: tuple[CallRow, ...]
    """Calls made."""
    times: tuple[StageTime, ...]
    """Seconds by stage."""
    saved: tuple[Saved, ...] = ()
    """Calls not made."""


async def decide(question: Question, proposal: Proposal, caller: Caller, config: MethodConfig) -> Decision:
    """Return the answers of all arms. Calls of one stage are under way at once; results keep a fixed order.

    Args:
        question: The query; its reference answer goes to the judge alone.
        proposal: Candidate views.
        caller: Sends the calls.
        config: The method's.

    Raises:
        RetryError: An endpoint failed for a reason that may pass.
        StopError: No call can succeed.
    """
    if proposal.status != "answered":
        if question.task == "ground_many" and proposal.status == "skipped" and not proposal.categories:
            # The model was asked and named none of the scene's categories: zero targets is an answer of this task.
            return undecided("answered", "", f"no target: {proposal.reason}")
        return undecided(proposal.status, proposal.reason)
    case = _Case(question, proposal, caller, config)
    try:
        return await case.decide()
    except QuestionError as error:
        failed = undecided("failed", f"{type(error).__name__}: {error}")
        return replace(failed, calls=tuple(case.calls), times=case.watch.times(), saved=case.savings.entries())


def undecided(status: Status, reason: str, text: str = "") -> Decision:
    """Return the decision on a question no model was shown a view of, or whose calls failed; it has no mark."""
    nothing = TaskAnswer(status, reason, text, ())
    arms = tuple(
        Arm(name, nothing, (), Mark(None, f"{status}: {reason}" if reason else _NO_REFERENCE)) for name in ARMS
    )
    return Decision((), (), arms, "", (), ())


class _Case:
    """One question before the models."""

    def __init__(self, question: Question, proposal: Proposal, caller: Caller, config: MethodConfig) -> None:
        self.question, self.proposal, self.caller, self.config = question, proposal, caller, config
        self.calls: list[CallRow] = []
        self.watch, self.savings = Stopwatch(), Savings()
        self.exact = config.judging.exact_savings
        self.views = ViewJudging(question, proposal, caller, config.judging, self.calls, self.watch, self.savings)

    async def decide(self) -> Decision:
        groups = self.proposal.seen
        choices = await self.views.choose()
        initial_views = [group.candidates[0].picture for group in groups]
        final_views = [
            None if choice.candidate is None else group.candidates[choice.candidate].picture
            for group, choice in zip(groups, choices, strict=True)
        ]
        final_frames = _frames(final_views)
        if self.config.judging.design == "all_views" and self.question.task != "ground_many":
            final_frames = _frames(self.views.every_picture())
        initial, final = await self._answer_arms(_frames(initial_views), final_frames, choices)
        verified, stands = await self._verify(initial, final, initial_views, final_views)
        arms = await self._marked([initial, final, verified])
        chosen = tuple(choice.candidate for choice in choices)
        times, saved = self.watch.times(), self.savings.entries()
        return Decision(tuple(self.views.answers), chosen, arms, stands, tuple(self.calls), times, saved)

    @property
    def _spared(self) -> Savings | None:
        """Where spared calls are counted; None where none is to be spared."""
        return self.savings if self.exact else None

    async def _answer(self, name: str, pictures: tuple[int, ...], calls: list[CallRow]) -> Arm:
        images = [self.proposal.pictures[picture] for picture in pictures]
        if self.question.task == "eqa":
            result = await answer_eqa(self.question, images, name, self.caller, calls)
        elif self.question.task == "ground_one":
            known = self.views.answers[pictures[0]] if len(pictures) == 1 else None
            result = await ground_one(self.question, images, known, name, self.caller, calls, self._spared)
        else:
            result = await ground_many(self.question, images, name, self.caller, calls)
        return Arm(name, result, pictures, _UNMARKED)

    async def _answer_arms(
        self, initial_frames: tuple[int, ...], final_frames: tuple[int, ...], choices: list[Choice]
    ) -> tuple[Arm, Arm]:
        """Answer from the initial and the final views; once where they are the same views."""
        readable = all(choice.candidate is not None for choice in choices)
        same = final_frames == initial_frames
        again = readable and not (same and self.exact)
        initial_calls: list[CallRow] = []
        final_calls: list[CallRow] = []
        asks = [self._answer("initial", initial_frames, initial_calls)]
        if again:
            asks.append(self._answer("final", final_frames, final_calls))
        with self.watch.stage("answer", len(asks)):
            try:
                arms = await _in_order(asks)
            finally:
                self.calls += initial_calls + final_calls
        if again:
            return arms[0], arms[1]
        if readable:
            self.savings.add("answer", SAME_VIEWS)
            return arms[0], replace(arms[0], name="final")
        reason = next(choice.reason for choice in choices if choice.candidate is None)
        return arms[0], Arm("final", TaskAnswer("unparsed", reason, "", ()), (), _UNMARKED)

    async def _verify(
        self, initial: Arm, final: Arm, initial_views: list[int], final_views: list[int | None]
    ) -> tuple[Arm, str]:
        """Return the verified arm and what stands (docs/decisions/0002-verification.md)."""
        same = initial.pictures == final.pictures
        if not self.config.judging.verify:
            return replace(final, name="verified"), ""
        if same and self.exact:
            if final.result.status == "answered":
                self._count_nothing_to_verify(initial_views)
            return replace(final, name="verified"), ""
        if final.result.status != "answered":
            return replace(initial, name="verified"), "initial"
        if self.question.task == "ground_many":
            return await self._verify_clusters(initial, final, initial_views, final_views)
        if initial.result.status != "answered":
            return replace(final, name="verified"), "final"
        with self.watch.stage("verify", 1):
            pair = (initial.result.text, final.result.text)
            stands = (await verify_answers(self.question, [pair], [""], self.caller, self.calls, self._spared))[0]
        if stands is None:
            return Arm("verified", TaskAnswer("unparsed", _UNVERIFIED, "", ()), (), _UNMARKED), ""
        if same:
            return replace(final, name="verified"), ""
        if stands == INITIAL:
            return replace(initial, name="verified"), "initial"
        return replace(final, name="verified"), "final"

    def _count_nothing_to_verify(self, initial_views: list[int]) -> None:
        if self.question.task != "ground_many":
            self.savings.add("verify", SAME_VIEWS)
            return
        self.savings.add("verify", SAME_VIEWS, sum(map(self._has_answer, initial_views)))
        self.savings.add("answer", SAME_VIEWS)

    def _has_answer(self, picture: int) -> bool:
        """Return whether a picture got an answer of its own, or would have without savings."""
        if self.config.judging.design in WITHOUT_ANSWERS:
            return False
        return picture not in self.views.asked or self.views.answers[picture] is not None

    async def _verify_clusters(
        self, initial: Arm, final: Arm, initial_views: list[int], final_views: list[int | None]
    ) -> tuple[Arm, str]:
        """Verify each cluster's chosen view against its initial one, by what the model said of each alone."""
        both = list(zip(initial_views, final_views, strict=True))
        # The choice by images asked for no answers.
        await self.views.answer(view for first, last in both if last not in (None, first) for view in (first, last))
        pairs: dict[int, tuple[str, str]] = {}
        stands: list[int] = [FINAL] * len(initial_views)
        for number, (first, last) in enumerate(both):
            before, after = self.views.answers[first], self.views.answers[last] if last is not None else None
            if first == last and self.exact:
                stands[number] = INITIAL
                self.savings.add("verify", SAME_VIEWS, int(self._has_answer(first)))
            elif after is None:
                stands[number] = INITIAL
            elif before is not None:
                pairs[number] = (before, after)
        with self.watch.stage("verify", len(pairs)):
            subjects = [f"cluster {number}" for number in pairs]
            texts = list(pairs.values())
            verdicts = await verify_answers(self.question, texts, subjects, self.caller, self.calls, self._spared)
        for number, verdict in zip(pairs, verdicts, strict=True):
            if verdict is None:
                return Arm("verified", TaskAnswer("unparsed", _UNVERIFIED, "", ()), (), _UNMARKED), ""
            stands[number] = verdict
        views = [last if verdict == FINAL else first for (first, last), verdict in zip(both, stands, strict=True)]
        frames = _frames(views)
        arm = "final" if frames == final.pictures else "initial" if frames == initial.pictures else "mixed"
        if arm != "mixed" and self.exact:
            self.savings.add("answer", SAME_VIEWS)
            return replace(final if arm == "final" else initial, name="verified"), arm
        with self.watch.stage("answer", 1):
            verified = await self._answer("verified", frames, self.calls)
        return verified, "" if initial.pictures == final.pictures else arm

    async def _marked(self, arms: list[Arm]) -> tuple[Arm, ...]:
        if not self.config.judging.mark or self.question.answer is None:
            reason = _NO_REFERENCE if self.question.answer is None else "marks are off"
            return tuple(replace(arm, mark=Mark(None, reason)) for arm in arms)
        texts = [arm.result.text if arm.result.status == "answered" else None for arm in arms]
        with self.watch.stage("judge", len({text for text in texts if text is not None})):
            names = [arm.name for arm in arms]
            marks = await mark_answers(self.question, texts, names, self.caller, self.calls, self._spared)
        return tuple(replace(arm, mark=mark) for arm, mark in zip(arms, marks, strict=True))


_NO_REFERENCE = "no reference answer"
_UNMARKED = Mark(None, "not judged")
_UNVERIFIED = "the verification could not be read"


def _frames(views: Sequence[int | None]) -> tuple[int, ...]:
    """Return the distinct views in order: clusters that share one share its frame."""
    return tuple(dict.fromkeys(view for view in views if view is not None))


async def _in_order(asks: Sequence[Coroutine[Any, Any, Arm]]) -> list[Arm]:
    """Await all; raise the first error in order only when none is left running."""
    results = await asyncio.gather(*asks, return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):
            raise result
    return [result for result in results if not isinstance(result, BaseException)]
