from __future__ import annotations

import threading
import time

import pytest

from workers import watchdog
from workers.watchdog import HeadLostError, HeadWatch, bounded

LOST_S = 0.2
HOUR_S = 3600.0


class Head:
    """Answers until told to fail or to hang."""

    def __init__(self) -> None:
        self.state, self.asked, self.released = "well", 0, threading.Event()

    def ask(self) -> str:
        self.asked += 1
        if self.state == "dead":
            raise ConnectionError("refused")
        if self.state == "stuck":
            self.released.wait(30)
        return self.state


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "TICK_S", 0.01)


def wait_until_lost(watch: HeadWatch) -> None:
    deadline = time.monotonic() + 10
    while not watch.lost:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_head_that_answers_is_never_lost() -> None:
    head = Head()
    with HeadWatch(head.ask, "it", lost_s=LOST_S) as watch:
        time.sleep(3 * LOST_S)
        watch.check()
    assert head.asked > 3


@pytest.mark.parametrize("state", ["dead", "stuck"])
def test_head_that_falls_silent_is_lost_after_a_while(state: str) -> None:
    head = Head()
    with HeadWatch(head.ask, "the Ray cluster at a:1", lost_s=LOST_S) as watch:
        time.sleep(0.05)
        head.state = state
        watch.check()
        wait_until_lost(watch)
        with pytest.raises(HeadLostError, match="the head of the Ray cluster at a:1 has not answered for "):
            watch.check()
    head.released.set()


def test_head_that_comes_back_in_time_is_not_lost() -> None:
    head = Head()
    with HeadWatch(head.ask, "it", lost_s=10.0) as watch:
        head.state = "dead"
        time.sleep(0.1)
        assert watch._silent_s > 0
        head.state = "well"
        before = head.asked
        while head.asked < before + 2:
            time.sleep(0.01)
        assert watch._silent_s < 0.1


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_pause_of_this_process_is_not_taken_for_silence(jump_s: float) -> None:
    # A process that was stopped sees its clock leap; the head had no chance to answer meanwhile.
    readings = iter([0.0, 0.01])

    def clock() -> float:
        return next(readings, jump_s)

    head = Head()
    head.state = "stuck"
    with HeadWatch(head.ask, "it", lost_s=LOST_S, clock=clock) as watch:
        time.sleep(0.2)
        assert not watch.lost
    head.released.set()


def test_call_that_never_returns_is_left_behind() -> None:
    released = threading.Event()
    before = time.monotonic()
    assert not bounded(lambda: released.wait(30), 0.05)
    assert time.monotonic() - before < 5
    released.set()


def test_call_that_ends_or_fails_in_time_is_waited_for() -> None:
    done: list[int] = []

    def fail() -> None:
        raise ConnectionError("gone")

    assert bounded(lambda: done.append(1), 10.0)
    assert done == [1]
    assert bounded(fail, 10.0)
