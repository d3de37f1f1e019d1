"""Savings: the exact ones change no answer and are counted to the call; the lossy ones leave out what they say."""

from __future__ import annotations

import asyncio
import dataclasses
import itertools
from typing import Any

import pytest

from pipeline.config import MethodConfig
from pipeline.models.clients import make_caller
from pipeline.models.config import ModelConfig
from pipeline.models.messages import Request
from pipeline.models.prompts import TemplateName
from pipeline.query.evidence import Evidence
from pipeline.query.judge import Design, JudgeConfig
from pipeline.query.savings import DEFINITE, EQUAL_ANSWERS, ONE_IMAGE, REDUNDANT, SAME_VIEWS, SINGLE_CANDIDATE
from pipeline.tasks.conclude import conclude
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Decision, decide
from pipeline.tasks.proposal import Proposal, propose
from schemas.questions import Question, Task
from tests.query.tiny import Scripted, caller_of, tiny_scene

CONTEXT = SceneContext(tiny_scene())
DESIGNS: tuple[Design, ...] = ("text", "image", "image_text")


def _question(task: Task) -> Question:
    return Question("q", "tiny", task, "what?", answer="a cup" if task == "eqa" else None)


def _proposal(task: Task, *categories: str, count: int = 4) -> Proposal:
    config = MethodConfig.model_validate({"novel_views": {"count": count}})
    return propose(CONTEXT, _question(task), Evidence("answered", "", categories, (), 0.0), config)


def _shade(request: Request) -> int:
    return sum(int(image.color.astype(int).sum()) for image in request.images())


def _first_best(request: Request) -> str:
    """A judge that keeps to its prompt: among equals it takes the lowest index."""
    seen = request.variables.get("candidates") or [image.sha256() for image in request.images()]
    return str(max(range(len(seen)), key=lambda i: (seen[i], -i)))


def _client(kinds: int) -> Scripted:
    """A model with so many different answers: 1 makes all alike, many make all differ."""
    return Scripted(
        {
            "view_answer": lambda request: f"shade {_shade(request) % kinds}",
            "choice": _first_best,
            "verify": _first_best,
            "answer_one": lambda request: f"Image {_shade(request) % len(request.images())}\nseen {_shade(request)}",
            "judge": lambda request: f"Your mark: {1 + len(request.variables['prediction']) % 5}",
        }
    )


def _decide(task: Task, proposal: Proposal, client: Scripted, **judging: Any) -> Decision:
    config = MethodConfig.model_validate({"judging": judging})
    return asyncio.run(decide(_question(task), proposal, caller_of(client), config))


def _saved(decision: Decision, reason: str) -> dict[str, int]:
    return {saved.stage: saved.calls for saved in decision.saved if saved.reason == reason}


def _answers(decision: Decision, proposal: Proposal, task: Task) -> list[Any]:
    """What counts of an answer; a single target is the view that is named, whatever is said of it."""
    views = [
        None if choice is None else group.candidates[choice].picture
        for group, choice in zip(proposal.seen, decision.choices, strict=True)
    ]
    results = [
        arm.result if task != "ground_one" else dataclasses.replace(arm.result, text="") for arm in decision.arms
    ]
    return [views, results, [(arm.name, arm.pictures, arm.mark) for arm in decision.arms], decision.stands]


TASKS: tuple[Task, ...] = ("eqa", "ground_one", "ground_many")
CASES = list(itertools.product(TASKS, DESIGNS, (1, 2, 1_000_000), (("chair",), ("table",), ("chair", "table"))))


@pytest.mark.parametrize("count", [0, 4])
@pytest.mark.parametrize(("task", "design", "kinds", "categories"), CASES)
def test_exact_savings_change_no_answer_and_are_counted_to_the_call(
    task: Task, design: Design, kinds: int, categories: tuple[str, ...], count: int
) -> None:
    proposal = _proposal(task, *categories, count=count)
    with_savings = _decide(task, proposal, _client(kinds), design=design)
    without = _decide(task, proposal, _client(kinds), design=design, exact_savings=False)
    assert without.saved == ()
    assert _answers(with_savings, proposal, task) == _answers(without, proposal, task)
    assert len(with_savings.calls) + sum(saved.calls for saved in with_savings.saved) == len(without.calls)


def test_exact_savings_are_on_by_default_and_lossy_policies_off() -> None:
    config = JudgeConfig()
    assert config.exact_savings
    assert not config.stop_when_definite
    assert not config.skip_redundant_views
    assert config.design == "text"


class TestEachExactSaving:
    def test_equal_answers(self) -> None:
        decision = _decide("eqa", _proposal("eqa", "chair"), _client(1))
        assert _saved(decision, EQUAL_ANSWERS) == {"choice": 2, "judge": 2}
        assert _saved(decision, SAME_VIEWS) == {"answer": 1, "verify": 1}

    def test_single_candidate(self) -> None:
        decision = _decide("eqa", _proposal("eqa", "chair", count=0), _client(9))
        assert _saved(decision, SINGLE_CANDIDATE) == {"choice": 2, "view_answer": 2}

    def test_one_image(self) -> None:
        decision = _decide("ground_one", _proposal("ground_one", "table"), _client(1_000_000))
        assert sum(_saved(decision, ONE_IMAGE).values()) >= 1
        assert not any(call.stage == "answer" for call in decision.calls)

    def test_equal_views_of_several_targets(self) -> None:
        decision = _decide("ground_many", _proposal("ground_many", "chair"), _client(1))
        assert _saved(decision, SAME_VIEWS) == {"answer": 2, "verify": 2}

    def test_the_answer_row_says_how_many_and_why(self) -> None:
        question, evidence = _question("eqa"), Evidence("answered", "", ("chair",), (), 0.0)
        proposal = _proposal("eqa", "chair")
        decision = _decide("eqa", proposal, _client(1))
        row = conclude(CONTEXT, question, evidence, proposal, decision, MethodConfig()).answers[0]
        assert row.calls_saved == 6
        assert row.saved == (
            "answer: same views: 1",
            "choice: equal answers: 2",
            "judge: equal answers: 2",
            "verify: same views: 1",
        )


class TestStopWhenDefinite:
    @pytest.mark.parametrize("design", ["text", "image_text"])
    def test_definite_initial_answers_end_the_choice_there(self, design: Design) -> None:
        proposal = _proposal("eqa", "chair", "table")
        client = Scripted({"view_answer": "The cup is red."})
        decision = _decide("eqa", proposal, client, stop_when_definite=True, design=design)
        initial = {group.candidates[0].picture for group in proposal.seen}
        assert {picture for picture, text in enumerate(decision.view_answers) if text is not None} == initial
        assert decision.choices == (0, 0, 0)
        assert (client.count("choice"), client.count("view_answer")) == (0, len(initial))
        assert _saved(decision, DEFINITE) == {"choice": 3, "view_answer": len(proposal.pictures) - len(initial)}

    @pytest.mark.parametrize("text", ["I cannot tell from this view.", "It looks like the cup is red."])
    def test_unsure_initial_answers_change_nothing(self, text: str) -> None:
        proposal = _proposal("eqa", "chair")
        first = [proposal.pictures[group.candidates[0].picture] for group in proposal.seen]
        replies = {"view_answer": lambda r: text if any(r.images()[0] is i for i in first) else f"A cup {_shade(r)}."}
        stopped = _decide("eqa", proposal, Scripted(replies), stop_when_definite=True)
        plain = _decide("eqa", proposal, Scripted(replies))
        assert _saved(stopped, DEFINITE) == {}
        assert _answers(stopped, proposal, "eqa") == _answers(plain, proposal, "eqa")

    def test_clusters_are_stopped_one_by_one(self) -> None:
        proposal = _proposal("eqa", "chair")
        first = proposal.pictures[proposal.seen[0].candidates[0].picture]
        client = Scripted({"view_answer": lambda r: "A red cup." if r.images()[0] is first else f"maybe {_shade(r)}"})
        decision = _decide("eqa", proposal, client, stop_when_definite=True)
        assert decision.choices == (0, 4)
        assert [call.subject for call in decision.calls if call.stage == "choice"] == ["cluster 1"]
        assert _saved(decision, DEFINITE)["choice"] == 1


class TestSkipRedundantViews:
    @staticmethod
    def _with_new(proposal: Proposal, new: tuple[int, ...]) -> Proposal:
        """The proposal with so many Gaussians newly seen by the candidates of every cluster."""
        groups = tuple(
            dataclasses.replace(
                group,
                candidates=tuple(
                    dataclasses.replace(c, quality=dataclasses.replace(c.quality, new_gaussians=n))
                    for c, n in zip(group.candidates, new, strict=True)
                ),
            )
            for group in proposal.groups
            if group.candidates
        )
        return dataclasses.replace(proposal, groups=groups)

    @pytest.mark.parametrize("design", DESIGNS)
    def test_views_that_show_nothing_new_are_neither_asked_nor_chosen(self, design: Design) -> None:
        proposal = self._with_new(_proposal("eqa", "table"), (0, 0, 5, 0, 1))
        client = Scripted({"choice": "2"})
        decision = _decide("eqa", proposal, client, skip_redundant_views=True, design=design)
        pictures = [candidate.picture for candidate in proposal.seen[0].candidates]
        asked = {picture for picture, text in enumerate(decision.view_answers) if text is not None}
        assert asked == (set() if design == "image" else {pictures[0], pictures[2], pictures[4]})
        choice = next(request for request in client.requests if request.stage == "choice")
        assert len(choice.images() or choice.variables["candidates"]) == 3
        assert decision.choices == (4,)
        assert _saved(decision, REDUNDANT) == ({} if design == "image" else {"view_answer": 2})

    @pytest.mark.parametrize(("share", "kept"), [(0.0, 3), (0.1, 3), (0.3, 2), (1.0, 1)])
    def test_a_share_of_the_cluster_says_what_is_new_enough(self, share: float, kept: int) -> None:
        proposal = _proposal("eqa", "table")
        size = proposal.seen[0].size
        proposal = self._with_new(proposal, (0, 0, size // 5, 0, size // 2))
        decision = _decide("eqa", proposal, Scripted({}), skip_redundant_views=True, redundant_share=share)
        assert sum(text is not None for text in decision.view_answers) == (kept if kept > 1 else 0)

    def test_when_no_view_shows_anything_new_nothing_is_asked(self) -> None:
        proposal = self._with_new(_proposal("eqa", "table"), (0, 0, 0, 0, 0))
        client = Scripted({})
        decision = _decide("eqa", proposal, client, skip_redundant_views=True)
        assert (client.count("view_answer"), client.count("choice"), client.count("answer_one")) == (0, 0, 1)
        assert _saved(decision, REDUNDANT) == {"view_answer": 4, "choice": 1}
        assert _saved(decision, SINGLE_CANDIDATE) == {"view_answer": 1}

    def test_when_all_views_show_something_new_nothing_changes(self) -> None:
        proposal = self._with_new(_proposal("eqa", "table"), (0, 1, 1, 1, 1))
        skipped = _decide("eqa", proposal, _client(9), skip_redundant_views=True)
        assert _answers(skipped, proposal, "eqa") == _answers(_decide("eqa", proposal, _client(9)), proposal, "eqa")
        assert _saved(skipped, REDUNDANT) == {}


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("design", DESIGNS)
def test_every_design_runs_offline_and_twice_alike(task: Task, design: Design) -> None:
    config = MethodConfig.model_validate({"judging": {"design": design}})
    question = Question("q", "tiny", task, "What is next to the table?", answer="a chair" if task == "eqa" else None)
    proposal, caller = _proposal(task, "table", "chair"), make_caller(ModelConfig(), None)
    first, second = (asyncio.run(decide(question, proposal, caller, config)) for _ in range(2))
    assert {arm.result.status for arm in first.arms} == {"answered"}
    assert {call.model for call in first.calls} == {"symbolic"}
    assert (first.arms, first.choices, first.saved) == (second.arms, second.choices, second.saved)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("design", DESIGNS)
def test_every_design_runs_to_an_answer_in_every_arm(task: Task, design: Design) -> None:
    proposal = _proposal(task, "chair", "table")
    client = _client(1_000_000)
    decision = _decide(task, proposal, client, design=design)
    assert {arm.result.status for arm in decision.arms} == {"answered"}
    choices = [request for request in client.requests if request.stage == "choice"]
    assert len(choices) == 3
    assert all(bool(request.images()) == (design != "text") for request in choices)
    assert all(("candidates" in request.variables) == (design != "image") for request in choices)
    if design == "image" and task == "eqa":
        assert client.count("view_answer") == 0
    names: dict[Design, TemplateName] = {"text": "choice", "image": "choice_image", "image_text": "choice_image_text"}
    hashes = {call.prompt_sha256 for call in decision.calls if call.stage == "choice"}
    assert hashes == {caller_of(client).prompts.sha256(names[design])}


class TestAllViews:
    """The design that chooses nothing: every candidate goes to the model at once."""

    @pytest.mark.parametrize("task", ["eqa", "ground_one"])
    def test_final_answer_sees_every_candidate_and_nothing_is_chosen(self, task: Task) -> None:
        proposal = _proposal(task, "chair", "table")
        client = _client(1_000_000)
        decision = _decide(task, proposal, client, design="all_views")
        everything = {candidate.picture for group in proposal.seen for candidate in group.candidates}
        assert client.count("view_answer") == client.count("choice") == 0
        assert set(decision.arms[1].pictures) == everything
        assert len(decision.arms[1].pictures) == len(everything) > len(decision.arms[0].pictures)
        assert {arm.result.status for arm in decision.arms} == {"answered"}

    def test_many_targets_keep_the_initial_views(self) -> None:
        decision = _decide("ground_many", _proposal("ground_many", "chair"), _client(9), design="all_views")
        assert decision.arms[0].pictures == decision.arms[1].pictures == decision.arms[2].pictures

    def test_views_that_a_policy_drops_are_not_shown(self) -> None:
        proposal = TestSkipRedundantViews._with_new(_proposal("eqa", "table"), (0, 0, 5, 0, 1))
        decision = _decide("eqa", proposal, _client(9), design="all_views", skip_redundant_views=True)
        assert len(decision.arms[1].pictures) == 3

    @pytest.mark.parametrize("task", TASKS)
    @pytest.mark.parametrize("count", [0, 4])
    def test_exact_savings_change_no_answer(self, task: Task, count: int) -> None:
        proposal = _proposal(task, "chair", "table", count=count)
        with_savings = _decide(task, proposal, _client(2), design="all_views")
        without = _decide(task, proposal, _client(2), design="all_views", exact_savings=False)
        assert _answers(with_savings, proposal, task) == _answers(without, proposal, task)
        assert len(with_savings.calls) + sum(saved.calls for saved in with_savings.saved) == len(without.calls)
