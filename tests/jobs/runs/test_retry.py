"""Questions that ended badly are done again, and nothing else comes out otherwise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from jobs.runs import retry as retry_module
from jobs.runs.events import read_events
from jobs.runs.lock import RunLock
from jobs.runs.retry import retry
from jobs.runs.status import run_status
from jobs.runs.submit import resume, submit
from jobs.scoring.aggregate import coverage
from schemas.errors import InputError, StopError
from schemas.run_folder import read_table
from tests.jobs.conftest import MakeJob
from tests.models.counting_server import CountingServer, digit
from tests.workers import calling_steps
from tests.workers.fake_steps import STEPS, answer, arm

MakeScene = Callable[..., Path]
MENDED = dataclasses.replace(STEPS, find_evidence=None)  # type: ignore[arg-type]


async def found(question: Any, vocabulary: Any, caller: Any, method: Any) -> str:
    """Evidence, once what made questions fail is mended."""
    return str(vocabulary[len(question.question) % 2])


MENDED = dataclasses.replace(STEPS, find_evidence=found)


def result_bytes(run: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(Path(run, "results").iterdir())}


@pytest.fixture
def job(make_scene: MakeScene, make_job: MakeJob) -> JobConfig:
    """A finished run of two scenes, units of three: two errors of two kinds in each scene."""
    for name in ("a", "b"):
        make_scene(name, ["q", "no evidence", "z", "y", "bug", "w", "v"])
    config = make_job()
    submit(config, steps=STEPS)
    return config


def test_questions_with_the_error_are_done_again_and_the_others_keep_their_rows(job: JobConfig) -> None:
    before = read_table(job.output, "answers").set_index("question_id")
    done = retry(job.output, error="QuestionError")
    assert (done.units, done.questions, done.others) == (2, 2, 4)
    assert coverage(job.output).pending == 6
    assert resume(job.output, steps=MENDED).driven.complete
    after = read_table(job.output, "answers").set_index("question_id")
    assert after.index.tolist() == before.index.tolist(), "none lost, none doubled, in order"
    redone = ["a-1", "b-1"]
    assert after.drop(redone).equals(before.drop(redone))
    assert (before.loc[redone, "status"] == "failed").all()
    assert (after.loc[redone, "status"] == "answered").all()
    assert [(f.error, f.message, f.questions) for f in run_status(job.output).failures] == [
        ("ZeroDivisionError", "division by zero", 2)
    ]


def test_retry_without_a_mended_cause_gives_the_same_tables(job: JobConfig) -> None:
    before = result_bytes(job.output)
    assert retry(job.output, status="failed").questions == 4
    assert resume(job.output, steps=STEPS).driven.complete
    assert result_bytes(job.output) == before
    assert run_status(job.output).statuses == {"answered": 10, "failed": 4}


def test_dry_run_changes_nothing(job: JobConfig) -> None:
    files = {path: path.read_bytes() for path in Path(job.output).rglob("*") if path.is_file()}
    assert retry(job.output, error="questionerror", dry_run=True).questions == 2
    assert {path: path.read_bytes() for path in Path(job.output).rglob("*") if path.is_file()} == files


@pytest.mark.parametrize("survived", [0, 1])
def test_retry_cut_short_is_finished_by_the_same_command(
    job: JobConfig, survived: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, done = retry_module.discard_unit, list[str]()

    def killed(run: str, unit: str, **details: Any) -> bool:
        if len(done) == survived:
            raise KeyboardInterrupt
        done.append(unit)
        return real(run, unit, **details)

    with monkeypatch.context() as patched:
        patched.setattr(retry_module, "discard_unit", killed)
        with pytest.raises(KeyboardInterrupt):
            retry(job.output, error="QuestionError")
    assert retry(job.output, error="QuestionError").units == 2 - survived
    assert resume(job.output, steps=MENDED).driven.complete
    assert run_status(job.output).statuses == {"answered": 12, "failed": 2}


def test_retry_while_a_driver_is_at_work_is_refused(job: JobConfig) -> None:
    with RunLock(job.output), pytest.raises(StopError, match="at work"):
        retry(job.output, status="failed")
    assert coverage(job.output).pending == 0


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({}, "an error or a status"),
        ({"status": "answered"}, "one of failed, unparsed, found answered"),
        ({"error": "X", "status": "unparsed"}, "only failed questions record one"),
        ({"error": "RateLimitError"}, r"one of QuestionError \(2\), ZeroDivisionError \(2\), found RateLimitError"),
        ({"status": "failed", "stage": "judge"}, "stage: expected no stage"),
    ],
)
def test_what_matches_nothing_says_what_there_is(job: JobConfig, asked: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        retry(job.output, **asked)
    assert coverage(job.output).pending == 0


def test_a_run_without_such_questions_has_nothing_to_do(job: JobConfig, tmp_path: Path) -> None:
    assert retry(job.output, status="unparsed").units == 0
    with pytest.raises(InputError, match="run folder"):
        retry(tmp_path / "none", status="failed")


def test_diary_tells_what_was_taken_back(job: JobConfig) -> None:
    retry(job.output, error="QuestionError")
    told = [event for event in read_events(job.output) if event["event"] == "discarded"]
    assert sorted(event["redone"] for event in told) == [["a-1"], ["b-1"]]
    assert {event["reason"] for event in told} == {"retry failed QuestionError"}


class TestUnparsed:
    """The calls go to a server whose replies to one question cannot be read, until it is mended."""

    def conclude(self, context: Any, question: Any, evidence: Any, proposal: Any, decision: Any, method: Any) -> Any:
        rows = calling_steps.conclude(context, question, evidence, proposal, decision, method)
        if all(asked.value is not None for asked in decision):
            return rows
        ended = {"status": "unparsed", "reason": "the answer could not be read"}
        return {
            **rows,
            "answers": (answer(question, **ended),),
            "arms": (arm(question, "final", mark=None, **ended),),
        }

    def test_its_unreadable_replies_are_forgotten_and_nothing_else_is_paid_again(
        self, make_scene: MakeScene, make_job: MakeJob
    ) -> None:
        make_scene("a", ["first", "second", "mumble"])
        steps = dataclasses.replace(calling_steps.STEPS, conclude=self.conclude)
        mended = list[bool]()

        def say(body: dict[str, Any]) -> str:
            return "hm" if "mumble" in str(body["messages"]) and not mended else digit(body)

        with CountingServer(say) as server:
            endpoint = {"kind": "openai", "base_url": server.base_url, "model": "m", "max_tokens": 50}
            job = make_job(models={"endpoints": {"e": endpoint}, "default": "e"})
            submit(job, steps=steps)
            before, paid = read_table(job.output, "answers").set_index("question_id"), server.sent
            assert before["status"].to_dict() == {"a-0": "answered", "a-1": "answered", "a-2": "unparsed"}
            with pytest.raises(InputError, match=r"stage: expected one of verify \(1\), found judge"):
                retry(job.output, status="unparsed", stage="judge")
            done = retry(job.output, status="unparsed", stage="verify")
            unreadable = (calling_steps.CALLS - 1) * job.models.max_asks
            assert (done.questions, done.others, done.forgotten) == (1, 2, unreadable)
            mended.append(True)
            assert resume(job.output, steps=steps).driven.complete
            assert server.sent - paid == calling_steps.CALLS - 1
        after = read_table(job.output, "answers").set_index("question_id")
        assert after["status"].tolist() == ["answered"] * 3
        assert after.drop("a-2").equals(before.drop("a-2"))
