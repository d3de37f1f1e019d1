from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.errors import InputError, QuestionError, RetryError, StopError, StoppedError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from tests.workers.fake_steps import failed_rows, unit
from workers.dispatch import (
    RETRY_WAIT_S,
    DeadlineError,
    Ended,
    Limits,
    OutOfMemoryError,
    WorkerLostError,
    dispatch,
)

Handle = tuple[tuple[str, int], ...]
"""Questions that travel together, each with the number of its try."""


@dataclass
class FakeBackend:
    """Ends `at_once` batches a wait, each question as `plan(question, try)` says: an exception, "hang" or rows.

    A lost worker or a question that hangs takes its whole batch with it.
    """

    plan: Callable[[str, int], Any]
    at_once: int = 1
    clock: float = 0.0
    tick: float = 1.0
    seconds: float = 0.0
    held: int = 0
    tries: dict[str, int] = field(default_factory=dict)
    submitted: list[str] = field(default_factory=list)
    batches: list[int] = field(default_factory=list)
    cancelled: list[str] = field(default_factory=list)
    forgotten: list[str] = field(default_factory=list)
    running: int = 0
    most: int = 0

    def submit(self, unit: PlannedUnit, questions: Sequence[Question]) -> Handle:
        names = [question.question_id for question in questions]
        for name in names:
            assert name in {question.question_id for question in unit.questions}
            self.tries[name] = self.tries.get(name, 0) + 1
        self.submitted += names
        self.batches.append(len(names))
        self.running += len(names)
        self.most = max(self.most, self.running)
        return tuple((name, self.tries[name]) for name in names)

    def wait(self, handles: Sequence[Handle], timeout_s: float) -> Sequence[Handle]:
        self.clock += self.tick
        ended = [h for h in handles if all(self.plan(*one) != "hang" for one in h)][: self.at_once]
        self.running -= sum(len(handle) for handle in ended)
        return ended

    def sleep(self, seconds: float) -> None:
        self.clock += seconds

    def result(self, handle: Handle) -> Ended:
        found = [self.plan(*one) for one in handle]
        for one in found:
            if isinstance(one, WorkerLostError):
                raise one
        return Ended(found, self.seconds * len(found), self.held * len(found))

    def cancel(self, handle: Handle) -> None:
        self.running -= len(handle)
        self.cancelled += [name for name, _ in handle]

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
    backend.submit = lambda u, q: (times[q[0].question_id].append(backend.clock), submit(u, q))[1]  # type: ignore
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
    ended: list[int] = []
    outcomes = dispatch(
        [unit(0, ["a"] * 9)], backend, Limits(3, 100.0, 2), clock=lambda: backend.clock, sleep=backend.sleep
    )
    with pytest.raises(StopError, match="bad key"):
        ended.extend(outcome.position for outcome in outcomes)
    # extend keeps what came before the error.
    assert ended == [0, 2, 3]
    assert len(backend.submitted) == 4


def test_work_that_stopped_as_asked_is_neither_an_outcome_nor_tried_again_nor_told() -> None:
    backend, notes = FakeBackend(lambda name, attempt: StoppedError("as asked") if attempt == 1 else {}), list[str]()
    outcomes = dispatch(
        [unit(0, ["a", "b"])],
        backend,
        Limits(2, 100.0, 2),
        should_stop=lambda: backend.clock >= 1,
        note=lambda kind, **details: notes.append(kind),
        clock=lambda: backend.clock,
        sleep=backend.sleep,
    )
    assert list(outcomes) == []
    assert len(backend.submitted) == 2
    assert notes == []


def test_backend_that_is_lost_is_noticed_before_the_next_result_is_waited_for() -> None:
    backend, asked = FakeBackend(lambda name, attempt: {"answers": ()}, at_once=3), list[str]()
    took = backend.result

    def result(handle: Handle) -> Ended:
        asked.append(handle[0][0])
        return took(handle)

    def lost() -> bool:
        if asked:
            raise StopError("the head is gone")
        return False

    backend.result = result  # type: ignore[method-assign]
    with pytest.raises(StopError):
        run(backend, [unit(0, ["a", "b", "c"])], should_stop=lost, limits={"batch": 1})
    assert len(asked) == 1


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
    lost=st.sets(st.integers(0, 29)),
    batch=st.none() | st.integers(1, 8),
)
def test_every_question_ends_once_within_the_window(
    sizes: list[int], in_flight: int, at_once: int, busy: set[int], lost: set[int], batch: int | None
) -> None:
    units = [unit(i, ["q"] * size) for i, size in enumerate(sizes)]
    names = [q.question_id for u in units for q in u.questions]
    flaky = {name for i, name in enumerate(names) if i in busy}
    deadly = {name for i, name in enumerate(names) if i in lost}

    def plan(name: str, attempt: int) -> Any:
        if name in deadly:
            return WorkerLostError("gone")
        return RetryError("busy") if name in flaky and attempt == 1 else {"answers": ()}

    backend = FakeBackend(plan, at_once)
    found = run(backend, units, limits={"in_flight": in_flight, "batch": batch, "retries": 1})
    assert {name: error for name, (_, error) in found.items()} == {
        name: "WorkerLostError" if name in deadly else "" for name in names
    }
    assert backend.most <= in_flight


def answered(name: str, attempt: int) -> Any:
    return {"answers": ()}


def test_batch_is_of_one_unit_and_cut_in_equal_pieces() -> None:
    backend = FakeBackend(answered)
    run(backend, [unit(0, ["a"] * 25), unit(1, ["a"] * 3)], limits={"in_flight": 40, "batch": 10})
    assert backend.batches == [9, 8, 8, 3]
    assert backend.submitted == [f"scene0-{i}" for i in range(25)] + [f"scene1-{i}" for i in range(3)]


@pytest.mark.parametrize(
    ("seconds", "together"), [(0.0, 50), (0.001, 50), (0.05, 10), (0.2, 2), (0.3, 1), (30.0, 1)], ids=str
)
def test_batch_grows_to_half_a_second_of_work(seconds: float, together: int) -> None:
    backend = FakeBackend(answered, seconds=seconds)
    run(backend, [unit(0, ["a"] * 408)], limits={"in_flight": 400, "batches": 8, "slots": 2})
    assert backend.batches[:8] == [1] * 8, "nothing is known before the first has ended"
    assert max(backend.batches[8:]) == together


def test_batch_leaves_every_slot_two_batches() -> None:
    backend = FakeBackend(answered)
    run(backend, [unit(0, ["a"] * 100)], limits={"in_flight": 24, "slots": 3})
    assert max(backend.batches) == 4


def test_bytes_in_flight_stay_within_the_memory_once_they_are_known() -> None:
    backend = FakeBackend(answered, held=1_000_000)
    run(backend, [unit(0, ["a"] * 60)], limits={"in_flight": 100, "batches": 8, "slots": 2, "memory": 12_500_000})
    assert backend.batches[:8] == [1] * 8
    assert max(backend.batches[8:]) == 3, "twelve fit, and each slot keeps two batches"
    assert backend.most == 12


def test_question_larger_than_the_memory_goes_alone() -> None:
    backend = FakeBackend(answered, held=1_000_000)
    assert len(run(backend, [unit(0, ["a"] * 9)], limits={"in_flight": 2, "memory": 10})) == 9
    assert backend.batches == [1] * 9


def test_lost_worker_is_nobody_elses_fault() -> None:
    backend = FakeBackend(lambda name, attempt: WorkerLostError("gone") if name == "scene0-3" else {"answers": ()})
    found = run(backend, [unit(0, ["a"] * 8)], limits={"in_flight": 8, "batch": 8, "retries": 0})
    assert found == {f"scene0-{i}": (2, "WorkerLostError" if i == 3 else "") for i in range(8)}
    assert backend.batches == [8] + [1] * 8
    assert backend.forgotten == ["unit0", "unit0"]


def test_question_that_hangs_holds_its_batch_to_the_deadline_only() -> None:
    backend = FakeBackend(lambda name, attempt: "hang" if name == "scene0-3" else {"answers": ()}, tick=10.0)
    found = run(backend, [unit(0, ["a"] * 4)], limits={"in_flight": 4, "batch": 4, "timeout_s": 25.0, "retries": 0})
    assert found == {f"scene0-{i}": (2, "DeadlineError" if i == 3 else "") for i in range(4)}


def test_question_that_runs_out_of_memory_is_left_alone_after_two_tries_of_its_own() -> None:
    def plan(name: str, attempt: int) -> Any:
        return OutOfMemoryError("killed") if name == "scene0-1" else {"answers": ()}

    backend = FakeBackend(plan)
    found = run(backend, [unit(0, ["a"] * 3)], limits={"in_flight": 3, "batch": 3, "retries": 9})
    assert found == {"scene0-0": (2, ""), "scene0-1": (3, "OutOfMemoryError"), "scene0-2": (2, "")}


def test_error_of_one_question_leaves_its_batch_alone() -> None:
    def plan(name: str, attempt: int) -> Any:
        return {"scene0-1": ValueError("bug"), "scene0-2": RetryError("busy")}.get(name, {"answers": ()})

    backend = FakeBackend(plan)
    found = run(backend, [unit(0, ["a"] * 4)], limits={"in_flight": 4, "batch": 4, "retries": 1})
    assert found == {
        "scene0-0": (1, ""),
        "scene0-1": (1, "ValueError"),
        "scene0-2": (2, "RetryError"),
        "scene0-3": (1, ""),
    }
    assert backend.batches == [4, 1]
