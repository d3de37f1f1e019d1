"""What the models decide on a proposal: view answers, choices, the answers of each arm, verification and marks."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pipeline.config import MethodConfig
from pipeline.models.caller import Caller
from pipeline.query.judge import Choice, answer_views, choose_views
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.query.verify import FINAL, INITIAL, verify_answers
from pipeline.tasks.eqa import answer_eqa
from pipeline.tasks.ground_many import ground_many
from pipeline.tasks.ground_one import ground_one
from pipeline.tasks.marks import Mark, mark_answers
from pipeline.tasks.proposal import Proposal
from pipeline.tasks.task_answer import TaskAnswer
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
        return replace(failed, calls=tuple(case.calls), times=case.watch.times())


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
        self.watch = Stopwatch()
        self.view_answers: list[str | None] = [None] * len(proposal.pictures)

    async def decide(self) -> Decision:
        groups = self.proposal.seen
        await self._answer_views()
        with self.watch.stage("choice", len(groups)):
            texts = [[self.view_answers[c.picture] for c in group.candidates] for group in groups]
            # With one candidate there is nothing to ask, not even what it shows.
            open_groups = [text for text in texts if len(text) > 1]
            made = iter(await choose_views(self.question, open_groups, self.caller, self.calls))
            choices = [next(made) if len(text) > 1 else Choice(0) for text in texts]
        initial_views = [group.candidates[0].picture for group in groups]
        final_views = [
            None if choice.candidate is None else group.candidates[choice.candidate].picture
            for group, choice in zip(groups, choices, strict=True)
        ]
        initial, final = await self._answer_arms(initial_views, final_views, choices)
        verified, stands = await self._verify(initial, final, initial_views, final_views)
        arms = await self._marked([initial, final, verified])
        chosen = tuple(choice.candidate for choice in choices)
        return Decision(tuple(self.view_answers), chosen, arms, stands, tuple(self.calls), self.watch.times())

    async def _answer_views(self) -> None:
        judged = [group for group in self.proposal.seen if len(group.candidates) > 1]
        asked = sorted({candidate.picture for group in judged for candidate in group.candidates})
        with self.watch.stage("view_answer", len(asked)):
            images = [self.proposal.pictures[picture] for picture in asked]
            subjects = [self.proposal.candidate_of(picture).id for picture in asked]
            answers = await answer_views(self.question, images, subjects, self.caller, self.calls)
        for picture, answer in zip(asked, answers, strict=True):
            self.view_answers[picture] = answer

    async def _answer(self, name: str, pictures: tuple[int, ...], calls: list[CallRow]) -> Arm:
        images = [self.proposal.pictures[picture] for picture in pictures]
        if self.question.task == "eqa":
            result = await answer_eqa(self.question, images, name, self.caller, calls)
        elif self.question.task == "ground_one":
            known = self.view_answers[pictures[0]] if len(pictures) == 1 else None
            result = await ground_one(self.question, images, known, name, self.caller, calls)
        else:
            result = await ground_many(self.question, images, name, self.caller, calls)
        return Arm(name, result, pictures, _UNMARKED)

    async def _answer_arms(
        self, initial_views: list[int], final_views: list[int | None], choices: list[Choice]
    ) -> tuple[Arm, Arm]:
        """Answer from the initial and the final views; once where they are the same views."""
        initial_frames, final_frames = _frames(initial_views), _frames(final_views)
        readable = all(choice.candidate is not None for choice in choices)
        again = readable and final_frames != initial_frames
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
            return arms[0], replace(arms[0], name="final")
        reason = next(choice.reason for choice in choices if choice.candidate is None)
        return arms[0], Arm("final", TaskAnswer("unparsed", reason, "", ()), (), _UNMARKED)

    async def _verify(
        self, initial: Arm, final: Arm, initial_views: list[int], final_views: list[int | None]
    ) -> tuple[Arm, str]:
        """Return the verified arm and what stands (docs/decisions/0002-verification.md)."""
        if not self.config.judging.verify or initial.pictures == final.pictures:
            return replace(final, name="verified"), ""
        if final.result.status != "answered":
            return replace(initial, name="verified"), "initial"
        if self.question.task == "ground_many":
            return await self._verify_clusters(initial, final, initial_views, final_views)
        if initial.result.status != "answered":
            return replace(final, name="verified"), "final"
        with self.watch.stage("verify", 1):
            pair = (initial.result.text, final.result.text)
            stands = (await verify_answers(self.question, [pair], [""], self.caller, self.calls))[0]
        if stands is None:
            return Arm("verified", TaskAnswer("unparsed", _UNVERIFIED, "", ()), (), _UNMARKED), ""
        if stands == INITIAL:
            return replace(initial, name="verified"), "initial"
        return replace(final, name="verified"), "final"

    async def _verify_clusters(
        self, initial: Arm, final: Arm, initial_views: list[int], final_views: list[int | None]
    ) -> tuple[Arm, str]:
        """Verify each cluster's chosen view against its initial one, by what the model said of each alone."""
        pairs: dict[int, tuple[str, str]] = {}
        stands: list[int] = [FINAL] * len(initial_views)
        for number, (first, last) in enumerate(zip(initial_views, final_views, strict=True)):
            before, after = self.view_answers[first], self.view_answers[last] if last is not None else None
            if first == last or after is None:
                stands[number] = INITIAL
            elif before is not None:
                pairs[number] = (before, after)
        with self.watch.stage("verify", len(pairs)):
            subjects = [f"cluster {number}" for number in pairs]
            verdicts = await verify_answers(self.question, list(pairs.values()), subjects, self.caller, self.calls)
        for number, verdict in zip(pairs, verdicts, strict=True):
            if verdict is None:
                return Arm("verified", TaskAnswer("unparsed", _UNVERIFIED, "", ()), (), _UNMARKED), ""
            stands[number] = verdict
        decided = zip(initial_views, final_views, stands, strict=True)
        views = [last if verdict == FINAL else first for first, last, verdict in decided]
        frames = _frames(views)
        if frames == final.pictures:
            return replace(final, name="verified"), "final"
        if frames == initial.pictures:
            return replace(initial, name="verified"), "initial"
        with self.watch.stage("answer", 1):
            return await self._answer("verified", frames, self.calls), "mixed"

    async def _marked(self, arms: list[Arm]) -> tuple[Arm, ...]:
        if not self.config.judging.mark or self.question.answer is None:
            reason = _NO_REFERENCE if self.question.answer is None else "marks are off"
            return tuple(replace(arm, mark=Mark(None, reason)) for arm in arms)
        texts = [arm.result.text if arm.result.status == "answered" else None for arm in arms]
        with self.watch.stage("judge", len({text for text in texts if text is not None})):
            names = [arm.name for arm in arms]
            marks = await mark_answers(self.question, texts, names, self.caller, self.calls)
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
