from __future__ import annotations

import asyncio

import pytest

from pipeline.config import MethodConfig
from pipeline.models.messages import Reply, Request
from pipeline.query.evidence import Evidence
from pipeline.query.savings import Savings
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Decision, decide
from pipeline.tasks.ground_one import ground_one
from pipeline.tasks.proposal import Proposal, propose
from schemas.errors import QuestionError, RetryError, StopError
from schemas.questions import Question, Task
from tests.query.tiny import Scripted, caller_of, tiny_scene

CONTEXT = SceneContext(tiny_scene())


def _proposal(*categories: str, task: Task = "eqa", **options: object) -> Proposal:
    evidence = Evidence("answered", "", categories, (), 0.0)
    return propose(CONTEXT, _question(task), evidence, MethodConfig.model_validate(options))


def _question(task: Task = "eqa", answer: str | None = "a cup") -> Question:
    return Question("q", "tiny", task, "what?", answer=answer if task == "eqa" else None)


def _decide(client: Scripted, proposal: Proposal, task: Task = "eqa", **options: object) -> Decision:
    return asyncio.run(decide(_question(task), proposal, caller_of(client), MethodConfig.model_validate(options)))


def _initial_pictures(proposal: Proposal) -> tuple[int, ...]:
    return tuple(dict.fromkeys(group.candidates[0].picture for group in proposal.seen))


def _chosen_pictures(proposal: Proposal, position: int) -> tuple[int, ...]:
    return tuple(dict.fromkeys(group.candidates[position].picture for group in proposal.seen))


class TestEqa:
    def test_arms_see_initial_and_chosen_views_and_verification_takes_one(self) -> None:
        proposal, client = _proposal("chair", "table"), Scripted({"choice": "2", "verify": "1"})
        decision = _decide(client, proposal)
        initial, final, verified = decision.arms
        assert [arm.name for arm in decision.arms] == ["initial", "final", "verified"]
        assert initial.pictures == _initial_pictures(proposal)
        assert final.pictures == _chosen_pictures(proposal, 2)
        assert (verified.pictures, verified.result) == (final.pictures, final.result)
        assert decision.stands == "final"
        assert decision.choices == (2, 2, 2)
        assert client.count("answer_one") == 2
        assert client.count("verify") == 1
        assert next(r for r in client.requests if r.stage == "verify").variables["candidates"] == [
            initial.result.text,
            final.result.text,
        ]

    def test_verification_can_keep_the_initial_answer(self) -> None:
        decision = _decide(Scripted({"verify": "0"}), _proposal("chair"))
        assert decision.stands == "initial"
        assert decision.arms[2].result == decision.arms[0].result != decision.arms[1].result

    def test_every_distinct_picture_is_asked_about_once(self) -> None:
        proposal, client = _proposal("chair", "table"), Scripted({})
        decision = _decide(client, proposal)
        assert client.count("view_answer") == len(proposal.pictures)
        assert None not in decision.view_answers

    def test_when_every_choice_is_the_initial_view_nothing_is_asked_twice(self) -> None:
        client = Scripted({"choice": "0"})
        decision = _decide(client, _proposal("chair"))
        assert (client.count("answer_one"), client.count("verify")) == (1, 0)
        assert decision.stands == ""
        assert len({arm.result for arm in decision.arms}) == 1

    def test_equal_view_answers_need_no_choice_and_no_verification(self) -> None:
        client = Scripted({"view_answer": "I cannot tell."})
        _decide(client, _proposal("chair"))
        assert (client.count("choice"), client.count("answer_one"), client.count("verify")) == (0, 1, 0)

    def test_without_novel_views_only_the_answer_is_asked(self) -> None:
        client = Scripted({})
        decision = _decide(client, _proposal("chair", novel_views={"count": 0}))
        assert [request.stage for request in client.requests] == ["answer_one", "judge"]
        assert decision.view_answers == (None, None)
        assert decision.choices == (0, 0)

    def test_verification_can_be_turned_off(self) -> None:
        client = Scripted({})
        decision = _decide(client, _proposal("chair"), judging={"verify": False})
        assert client.count("verify") == 0
        assert decision.arms[2].result == decision.arms[1].result


class TestMarks:
    def test_each_distinct_answer_is_judged_once(self) -> None:
        client = Scripted({"judge": lambda r: f"Your mark: {1 + len(r.variables['prediction']) % 5}"})
        decision = _decide(client, _proposal("chair"))
        assert client.count("judge") == 2
        assert all(arm.mark.mark == 1 + len(arm.result.text) % 5 for arm in decision.arms)
        variables = next(r for r in client.requests if r.stage == "judge").variables
        assert (variables["answer"], variables["extra_answers"]) == ("a cup", [])

    def test_without_reference_answer_nothing_is_judged_and_the_reason_says_so(self) -> None:
        client = Scripted({})
        question = _question(answer=None)
        decision = asyncio.run(decide(question, _proposal("chair"), caller_of(client), MethodConfig()))
        assert client.count("judge") == 0
        assert {(arm.mark.mark, arm.mark.reason) for arm in decision.arms} == {(None, "no reference answer")}

    def test_an_unreadable_mark_is_unscored_with_a_reason(self) -> None:
        decision = _decide(Scripted({"judge": "splendid"}), _proposal("chair"))
        assert {arm.mark.mark for arm in decision.arms} == {None}
        assert all("could not be read" in arm.mark.reason for arm in decision.arms)


class TestUnreadable:
    def test_an_unreadable_choice_leaves_the_final_arm_unparsed_and_the_initial_answer_standing(self) -> None:
        decision = _decide(Scripted({"choice": "any of them"}), _proposal("chair"))
        initial, final, verified = decision.arms
        assert (initial.result.status, final.result.status, verified.result.status) == (
            "answered",
            "unparsed",
            "answered",
        )
        assert "cluster 0" in final.result.reason
        assert (verified.result, decision.stands) == (initial.result, "initial")
        assert decision.choices == (None, None)
        assert final.mark.mark is None
        assert initial.mark.mark == 4

    def test_unreadable_answers_leave_all_arms_unparsed(self) -> None:
        client = Scripted({"answer_one": "it is red"})
        decision = _decide(client, _proposal("chair"))
        assert {arm.result.status for arm in decision.arms} == {"unparsed"}
        assert all(arm.result.reason for arm in decision.arms)
        assert (client.count("verify"), client.count("judge")) == (0, 0)

    def test_an_unreadable_initial_answer_leaves_the_final_one(self) -> None:
        proposal = _proposal("chair")
        first = proposal.pictures[_initial_pictures(proposal)[0]]
        decision = _decide(
            Scripted({"answer_one": lambda r: "?" if r.images()[0] is first else "Image 0\na cup"}), proposal
        )
        assert [arm.result.status for arm in decision.arms] == ["unparsed", "answered", "answered"]
        assert decision.stands == "final"

    def test_an_unreadable_verdict_leaves_the_verified_arm_unparsed(self) -> None:
        decision = _decide(Scripted({"verify": "both"}), _proposal("chair"))
        assert [arm.result.status for arm in decision.arms] == ["answered", "answered", "unparsed"]
        assert "verification" in decision.arms[2].result.reason

    def test_a_cluster_whose_views_got_no_answer_leaves_the_final_arm_unparsed(self) -> None:
        decision = _decide(Scripted({"view_answer": ""}), _proposal("table"))
        assert [arm.result.status for arm in decision.arms] == ["answered", "unparsed", "answered"]
        assert "no view of cluster 0" in decision.arms[1].result.reason


class TestGroundOne:
    def test_the_named_image_is_chosen(self) -> None:
        client = Scripted({"answer_one": "Image 1\nthe left chair"})
        decision = _decide(client, _proposal("chair", task="ground_one"), "ground_one")
        assert {arm.result.chosen for arm in decision.arms} == {(1,)}

    def test_with_one_image_its_view_answer_is_taken_and_nothing_more_is_asked(self) -> None:
        proposal, client = _proposal("table", task="ground_one"), Scripted({})
        decision = _decide(client, proposal, "ground_one")
        assert client.count("answer_one") == 0
        assert all(arm.result.chosen == (0,) for arm in decision.arms)
        assert decision.arms[0].result.text == decision.view_answers[proposal.seen[0].candidates[0].picture]

    @pytest.mark.parametrize("reply", ["Image 0\nthe table", "Image 0: it is not here"])
    def test_one_image_skip_chooses_what_any_readable_reply_would(self, reply: str) -> None:
        image, caller = _proposal("table", task="ground_one").pictures[0], caller_of(Scripted({"answer_one": reply}))
        question = _question("ground_one")
        asked = asyncio.run(ground_one(question, [image], None, "final", caller, [], Savings()))
        skipped = asyncio.run(ground_one(question, [image], "a table", "final", caller, [], Savings()))
        assert asked.chosen == skipped.chosen == (0,)
        assert asked.text != skipped.text == "a table"

    def test_without_novel_views_the_only_image_is_asked_about(self) -> None:
        client = Scripted({})
        _decide(client, _proposal("table", task="ground_one", novel_views={"count": 0}), "ground_one")
        assert [request.stage for request in client.requests] == ["answer_one"]


class TestGroundMany:
    def test_images_said_to_show_a_target_are_chosen(self) -> None:
        client = Scripted({"answer_many": "Image 0: No\nImage 1: Yes"})
        decision = _decide(client, _proposal("chair", task="ground_many"), "ground_many")
        assert {arm.result.chosen for arm in decision.arms} == {(1,)}

    def test_no_image_is_an_answer(self) -> None:
        client = Scripted({"answer_many": "Image 0: No\nImage 1: No"})
        decision = _decide(client, _proposal("chair", task="ground_many"), "ground_many")
        assert {(arm.result.status, arm.result.chosen) for arm in decision.arms} == {("answered", ())}

    def test_each_cluster_is_verified_alone_and_a_mixture_is_answered_again(self) -> None:
        proposal = _proposal("chair", task="ground_many")
        first = proposal.seen[0].candidates

        def verify(request: Request) -> str:
            return "0" if request.variables["candidates"][0] == answers[first[0].picture] else "1"

        client = Scripted({"choice": "1", "verify": verify})
        answers = _decide(Scripted({}), proposal, "ground_many").view_answers
        decision = _decide(client, proposal, "ground_many")
        second = proposal.seen[1].candidates
        assert decision.arms[2].pictures == (first[0].picture, second[1].picture)
        assert decision.stands == "mixed"
        assert (client.count("verify"), client.count("answer_many")) == (2, 3)
        assert [call.subject for call in decision.calls if call.stage == "verify"] == ["cluster 0", "cluster 1"]
        assert [call.subject for call in decision.calls if call.stage == "answer"] == ["initial", "final", "verified"]

    @pytest.mark.parametrize(("verdict", "arm"), [("0", "initial"), ("1", "final")])
    def test_unanimous_verdicts_reuse_the_answer_of_that_arm(self, verdict: str, arm: str) -> None:
        client = Scripted({"verify": verdict})
        decision = _decide(client, _proposal("chair", task="ground_many"), "ground_many")
        assert decision.stands == arm
        assert client.count("answer_many") == 2
        assert decision.arms[2].result == decision.arms[arm == "final"].result

    def test_an_unreadable_cluster_verdict_leaves_the_verified_arm_unparsed(self) -> None:
        decision = _decide(Scripted({"verify": "hm"}), _proposal("chair", task="ground_many"), "ground_many")
        assert [arm.result.status for arm in decision.arms] == ["answered", "answered", "unparsed"]

    def test_unparsed_verdicts_are_not_counted_as_no(self) -> None:
        client = Scripted({"answer_many": "Image 0: Yes"})
        decision = _decide(client, _proposal("chair", task="ground_many"), "ground_many")
        assert {arm.result.status for arm in decision.arms} == {"unparsed"}


class Failing(Scripted):
    """Raises in one stage."""

    def __init__(self, stage: str, error: Exception) -> None:
        super().__init__({})
        self.stage, self.error = stage, error

    async def complete(self, request: Request) -> Reply:
        if request.stage == self.stage:
            raise self.error
        return await super().complete(request)


@pytest.mark.parametrize("stage", ["view_answer", "choice", "answer_one", "verify", "judge"])
def test_a_refused_call_fails_the_question_and_keeps_the_calls_made(stage: str) -> None:
    decision = _decide(Failing(stage, QuestionError("content policy")), _proposal("chair"))
    assert {arm.result.status for arm in decision.arms} == {"failed"}
    assert all("content policy" in arm.result.reason for arm in decision.arms)
    assert "QuestionError" in [call.outcome for call in decision.calls]
    assert decision.times


@pytest.mark.parametrize("error", [RetryError("timeout"), StopError("bad key")])
def test_errors_that_are_not_the_questions_own_go_on(error: Exception) -> None:
    from pipeline.models.caller import Caller
    from pipeline.models.prompts import Prompts
    from pipeline.models.retry import RetryPolicy
    from tests.query.tiny import STAGES

    client = Failing("choice", error)
    caller = Caller(dict.fromkeys(STAGES, client), Prompts.load(), None, retry=RetryPolicy(max_tries=1))
    with pytest.raises(type(error)):
        asyncio.run(decide(_question(), _proposal("chair"), caller, MethodConfig()))


def test_skipped_proposal_asks_nothing() -> None:
    evidence = Evidence("skipped", "no evidence", (), (), 0.0)
    proposal = propose(CONTEXT, _question(), evidence, MethodConfig())
    client = Scripted({})
    decision = _decide(client, proposal)
    assert not client.requests
    assert {(arm.result.status, arm.result.reason) for arm in decision.arms} == {("skipped", "no evidence")}
    assert {arm.mark.mark for arm in decision.arms} == {None}, "what was not answered is not scored"


def test_unparsed_evidence_is_unmarked_with_a_reason() -> None:
    evidence = Evidence("unparsed", "no name", (), (), 0.0)
    decision = _decide(Scripted({}), propose(CONTEXT, _question(), evidence, MethodConfig()))
    assert all(arm.mark.mark is None and "no name" in arm.mark.reason for arm in decision.arms)
