from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.errors import InputError, QuestionError, RetryError, StopError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from tests.workers.fake_steps import failed_rows, unit
from workers.dispatch import RETRY_WAIT_S, DeadlineError, Limits, WorkerLostError, dispatch


@dataclass
class FakeBackend:
    """Ends `at_once` questions a wait, each as `plan(question, try)` says: an exception, "hang" or rows."""

    plan: Callable[[str, int], Any]
    at_once: int = 1
    clock: float = 0.0
    tick: float = 1.0
    tries: dict[str, int] = field(default_factory=dict)
    submitted: list[str] = field(default_factory=list)
    cancelled: list[str] = field(default_factory=list)
    forgotten: list[str] = field(default_factory=list)
    running: int = 0
    most: int = 0

    def submit(self, unit: PlannedUnit, question: Question) -> tuple[str, int]:
        name = question.question_id
        self.tries[name] = self.tries.get(name, 0) + 1
        self.submitted.append(name)
        self.running += 1
        self.most = max(self.most, self.running)
        return name, self.tries[name]

    def wait(self, handles: Sequence[tuple[str, int]], timeout_s: float) -> Sequence[tuple[str, int]]:
        self.clock += self.tick
        ended = [handle for handle in handles if self.plan(*handle) != "hang"][: self.at_once]
        self.running -= len(ended)
        return ended

    def sleep(self, seconds: float) -> None:
        self.clock += seconds

    def result(self, handle: tuple[str, int]) -> Any:
        found = self.plan(*handle)
        if isinstance(found, Exception):
            raise found
        return found

    def cancel(self, handle: tuple[str, int]) -> None:
        self.cancelled.append(handle[0])

    def forget(self, unit: PlannedUnit) -> None:
        self.forgotten.append(unit.id)

    def failed(self, question: Question, error: Exception) -> Any:
        return failed_rows(question, error)


def run(backend: FakeBackend, units: list[PlannedUnit], **changes: Any) -> dict[str, tuple[int, str]]:
    limits = Limits(**{"in_flight": 3, "timeout_s": 100.0, "retries": 2, "drain_s": 5.0, **changes.pop("limits", {})})
    outcomes = list(dispatch(units, backend, limits, clock=lambda: backend.clock, sleep=backend.sleep, **changes))
    found = {o.unit.questions[o.position].question_id: (o.tries, o.error) for o in outcomes}
    assert len(found) == len(outcomes), "a question ended twice"
    return found


@pytest.mark.parametrize("error", [QuestionError("no"), InputError("f", expected="x", found="y"), ValueError("bug")])
def test_error_that_will_not_pass_becomes_a_failed_row_without_a_retry(error: Exception) -> None:
    notes: list[tuple[str, dict[str, Any]]] = []
    backend = FakeBackend(lambda name, attempt: error if name == "scene0-1" else {"answers": ()})
    found = run(backend, [unit(0, ["a", "b", "c"])], note=lambda kind, **details: notes.append((kind, details)))
    assert found == {"scene0-0": (1, ""), "scene0-1": (1, type(error).__name__), "scene0-2": (1, "")}
    assert [(kind, details["error"]) for kind, details in notes] == [("failed", type(error).__name__)]
    assert ("traceback" in notes[0][1]) == isinstance(error, ValueError)


@pytest.mark.parametrize(("error", "forgotten"), [(RetryError("busy"), 0), (WorkerLostError("gone"), 2)])
def test_error_that_may_pass_is_tried_again_and_a_lost_scene_loaded_anew(error: Exception, forgotten: int) -> None:
    backend = FakeBackend(lambda name, attempt: error if attempt < 3 else {"answers": ()})
    assert run(backend, [unit(0, ["a"])]) == {"scene0-0": (3, "")}
    assert backend.forgotten == ["unit0"] * forgotten


def test_tries_wait_longer_each_time_while_other_questions_go_on() -> None:
    times: dict[str, list[float]] = {"scene0-0": [], "scene0-1": []}

    def plan(name: str, attempt: int) -> Any:
        return WorkerLostError("gone") if name == "scene0-0" and attempt < 3 else {"answers": ()}

    backend = FakeBackend(plan, tick=0.25)
    submit = backend.submit
    backend.submit = lambda u, q: (times[q.question_id].append(backend.clock), submit(u, q))[1]  # type: ignore
    run(backend, [unit(0, ["a", "a"])], limits={"in_flight": 1})
    first, second, third = times["scene0-0"]
    assert second - first >= RETRY_WAIT_S
    assert third - second >= 2 * RETRY_WAIT_S
    assert times["scene0-1"][0] < second


def test_error_that_keeps_coming_fails_after_the_last_try() -> None:
    backend = FakeBackend(lambda name, attempt: RetryError("busy"))
    assert run(backend, [unit(0, ["a"])]) == {"scene0-0": (3, "RetryError")}
    assert backend.tries == {"scene0-0": 3}


def test_question_without_a_result_in_time_is_cancelled_and_tried_again() -> None:
    backend = FakeBackend(lambda name, attempt: "hang" if attempt == 1 else {"answers": ()}, tick=10.0)
    assert run(backend, [unit(0, ["a"])], limits={"timeout_s": 25.0}) == {"scene0-0": (2, "")}
    assert backend.cancelled == ["scene0-0"]


def test_question_that_always_hangs_fails_with_the_deadline() -> None:
    backend = FakeBackend(lambda name, attempt: "hang", tick=10.0)
    found = run(backend, [unit(0, ["a"])], limits={"timeout_s": 25.0, "retries": 1})
    assert found == {"scene0-0": (2, DeadlineError.__name__)}


def test_stop_error_ends_the_run_after_what_is_in_flight() -> None:
    backend = FakeBackend(lambda name, attempt: StopError("bad key") if name == "scene0-1" else {"answers": ()})
    ended = []
    outcomes = dispatch(
        [unit(0, ["a"] * 9)], backend, Limits(3, 100.0, 2), clock=lambda: backend.clock, sleep=backend.sleep
    )
    with pytest.raises(StopError, match="bad key"):
        ended.extend(outcome.position for outcome in outcomes)
    # extend keeps what came before the error.
    assert ended == [0, 2, 3]
    assert len(backend.submitted) == 4


def test_wish_to_stop_begins_nothing_new_and_lets_the_rest_end() -> None:
    backend = FakeBackend(lambda name, attempt: {"answers": ()})
    found = run(backend, [unit(0, ["a"] * 9)], should_stop=lambda: backend.clock >= 2)
    assert len(found) == len(backend.submitted) == 4


def test_wish_to_stop_gives_up_questions_that_do_not_end() -> None:
    backend = FakeBackend(lambda name, attempt: "hang" if name == "scene0-0" else {"answers": ()})
    found = run(backend, [unit(0, ["a"] * 9)], should_stop=lambda: backend.clock >= 1)
    assert set(found) == {"scene0-1", "scene0-2"}
    assert backend.cancelled == ["scene0-0"]


@settings(max_examples=60, deadline=None)
@given(
    sizes=st.lists(st.integers(1, 6), min_size=1, max_size=5),
    in_flight=st.integers(1, 7),
    at_once=st.integers(1, 7),
    busy=st.sets(st.integers(0, 29)),
)
def test_every_question_ends_once_within_the_window(
    sizes: list[int], in_flight: int, at_once: int, busy: set[int]
) -> None:
    units = [unit(i, ["q"] * size) for i, size in enumerate(sizes)]
    names = [q.question_id for u in units for q in u.questions]
    flaky = {name for i, name in enumerate(names) if i in busy}
    backend = FakeBackend(
        lambda name, attempt: RetryError("busy") if name in flaky and attempt == 1 else {"answers": ()}, at_once
    )
    found = run(backend, units, limits={"in_flight": in_flight})
    assert found == {name: (2 if name in flaky else 1, "") for name in names}
    assert backend.most <= in_flight
