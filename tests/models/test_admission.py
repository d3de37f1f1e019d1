"""Admissions: order, concurrency that halves and grows, pauses, caps that hold, journals that survive."""

from __future__ import annotations

import heapq
from pathlib import Path

import numpy as np
import pytest

from pipeline.models.admission import Admission, Concurrency, Done, Wish
from pipeline.models.budget import Budget, BudgetConfig
from pipeline.models.cache import CallCache
from pipeline.models.config import EndpointConfig, ModelConfig
from pipeline.models.journal import Journal
from pipeline.models.messages import Reply
from pipeline.models.rate import RateWindow
from pipeline.models.traffic import open_admissions


def admission(
    requests: int | None = None, tokens: int | None = None, concurrency: int = 100, caps: BudgetConfig | None = None
) -> Admission:
    budget = Budget(caps or BudgetConfig())
    return Admission(RateWindow(requests, tokens), Concurrency(concurrency), budget, lost_after_s=100.0)


def wishes(count: int, tokens: int = 10, usd: float = 0.0) -> list[Wish]:
    return [Wish(str(number), tokens, usd) for number in range(count)]


@pytest.mark.parametrize(
    ("requests", "tokens", "calls"), [(600, None, 3_000), (None, 200_000, 1_000), (1500, 1_000_000, 10_000)]
)
def test_thousands_of_calls_keep_to_their_limits_and_use_them(
    requests: int | None, tokens: int | None, calls: int
) -> None:
    rng = np.random.default_rng(0)
    gate, now, ending, arrived = admission(requests, tokens, 64), 0.0, list[tuple[float, str, int]](), list[list]()
    for wish in wishes(calls, tokens=2000):
        gate.wish(wish)
    left = calls
    while left:
        answer = gate.grant(now)
        for name in answer.granted:
            used, latency = int(rng.integers(300, 2000)), rng.uniform(0.3, 3)
            arrived.append([now + rng.uniform(0, 0.4), used])  # the server sees it a little later
            heapq.heappush(ending, (now + latency, name, used))
        times = [ending[0][0]] if ending else []
        now = min(times if answer.wait_s is None else [*times, now + answer.wait_s])
        while ending and ending[0][0] <= now:
            _, name, used = heapq.heappop(ending)
            gate.done(Done(name, used, 0.0), now)
            left -= 1
    at, used = np.array(sorted(arrived)).T
    sums = np.concatenate([[0], np.cumsum(used)])
    last = np.searchsorted(at, at + 60.0)
    in_a_minute = last - np.arange(calls)
    tokens_in_a_minute = sums[last] - sums[:-1]
    shares = []
    if requests is not None:
        assert in_a_minute.max() <= requests
        shares.append(calls / (at[-1] / 60) / requests)
    if tokens is not None:
        assert tokens_in_a_minute.max() <= tokens
        shares.append(used.sum() / (at[-1] / 60) / tokens)
    assert max(shares) >= 0.95


def test_grant_keeps_the_order_of_wishes_and_the_number_under_way() -> None:
    gate = admission(concurrency=2)
    for wish in wishes(4):
        gate.wish(wish)
    assert gate.grant(0.0).granted == ("0", "1")
    assert gate.grant(1.0).granted == ()
    gate.done(Done("1", 5, 0.0), 2.0)
    assert gate.grant(2.0).granted == ("2",)


def test_wish_told_twice_counts_once_and_says_that_it_is_under_way() -> None:
    gate = admission()
    wish = Wish("a", 10, 0.0)
    assert not gate.wish(wish)
    assert not gate.wish(wish)
    assert gate.grant(0.0).granted == ("a",)
    assert gate.wish(wish)
    assert gate.grant(0.0).granted == ()


def test_concurrency_halves_once_for_calls_sent_together_and_grows_by_one_a_round() -> None:
    limit = Concurrency(16)
    for _ in range(5):
        limit.overloaded(sent_s=1.0, now_s=2.0)
    assert limit.limit == 8
    limit.overloaded(sent_s=3.0, now_s=4.0)
    assert limit.limit == 4
    for _ in range(4):
        limit.went_well()
    assert 4.8 < limit.limit <= 5
    for _ in range(1000):
        limit.went_well()
    assert limit.limit == 16


def test_concurrency_never_falls_below_one() -> None:
    limit = Concurrency(3)
    for second in range(10):
        limit.overloaded(second + 0.5, second + 0.6)
    assert limit.limit == 1


def test_retry_after_holds_everyone_to_the_second() -> None:
    gate = admission()
    for wish in wishes(3):
        gate.wish(wish)
    gate.grant(0.0)
    gate.done(Done("0", 0, 0.0, overloaded=True, pause_s=7.0), 1.0)
    gate.wish(Wish("next", 10, 0.0))
    answer = gate.grant(1.0)
    assert answer.granted == ()
    assert answer.wait_s == pytest.approx(7.0)
    assert gate.grant(8.0 - 1e-3).granted == ()
    assert gate.grant(8.0).granted == ("next",)


def test_a_lost_call_frees_its_place_and_stays_spent() -> None:
    gate = admission(concurrency=1, caps=BudgetConfig(tokens=100))
    gate.wish(Wish("lost", 60, 0.0))
    gate.wish(Wish("next", 60, 0.0))
    gate.grant(0.0)
    assert gate.grant(99.0) == gate.grant(99.0)
    refused = gate.grant(100.0).refused
    assert [name for name, _ in refused] == ["next"]
    assert "60 of 100 tokens" in refused[0][1]


@pytest.mark.parametrize(
    ("caps", "granted"), [({"calls": 3}, 3), ({"tokens": 35}, 3), ({"usd": 0.5}, 2), ({"calls": 0}, 0)]
)
def test_no_call_starts_beyond_a_cap(caps: dict[str, float], granted: int) -> None:
    gate = admission(caps=BudgetConfig(**caps))
    for wish in wishes(6, tokens=10, usd=0.2):
        gate.wish(wish)
    sent, refused, now = list[str](), list[str](), 0.0
    while len(sent) + len(refused) < 6:
        answer = gate.grant(now)
        sent += answer.granted
        refused += [name for name, _ in answer.refused]
        for name in answer.granted:
            gate.done(Done(name, 10, 0.2), now)
        now += 1.0
    assert len(sent) == granted


def test_a_cap_waits_for_calls_under_way_that_may_use_less() -> None:
    gate = admission(caps=BudgetConfig(tokens=100))
    for wish in wishes(2, tokens=80):
        gate.wish(wish)
    assert gate.grant(0.0).granted == ("0",)
    assert gate.grant(1.0).refused == ()
    gate.done(Done("0", 15, 0.0), 2.0)
    assert gate.grant(2.0).granted == ("1",)


MODELS = ModelConfig(
    endpoints={
        "e": EndpointConfig(kind="openai", base_url="http://h/v1", model="m", requests_per_min=3, concurrency=2)
    },
    default="e",
)


def test_a_killed_admission_made_anew_holds_rate_concurrency_and_caps(tmp_path: Path) -> None:
    caps = BudgetConfig(calls=4)
    first = open_admissions(MODELS, caps, tmp_path, "s1", clock=lambda: 1000.0, wall_clock=lambda: 5000.0)["e"]
    for name in "abc":
        first.wish(Wish(name, 10, 0.0))
    assert first.grant(1000.0).granted == ("a",)
    assert first.grant(1006.0).granted == ("b",)
    first.done(Done("a", 7, 0.0), 1006.0)
    # Killed here. Its successor has another monotonic clock; the wall clock says that six seconds have passed.
    second = open_admissions(MODELS, caps, tmp_path, "s1", clock=lambda: 10.0, wall_clock=lambda: 5006.0)["e"]
    assert second.wish(Wish("b", 10, 0.0))
    for name in "cde":
        second.wish(Wish(name, 10, 0.0))
    granted = second.grant(10.0)
    assert granted.granted == ("c",)
    assert second.grant(16.0).granted == ()  # two under way
    second.done(Done("b", 7, 0.0), 16.0)
    assert second.grant(16.0).granted == ()  # three in this minute
    assert second.grant(64.6).granted == ("d",)
    second.done(Done("c", 7, 0.0), 65.0)
    second.done(Done("d", 7, 0.0), 65.0)
    assert [name for name, _ in second.grant(66.0).refused] == ["e"]


@pytest.mark.parametrize(("later_s", "left_s"), [(600.0, 3000.0), (3601.0, 0.0), (-3600.0, 3600.0)])
def test_a_wait_that_the_server_asked_for_outlasts_the_session(tmp_path: Path, later_s: float, left_s: float) -> None:
    first = open_admissions(MODELS, BudgetConfig(), tmp_path, "s1", clock=lambda: 0.0, wall_clock=lambda: 9000.0)["e"]
    first.wish(Wish("a", 10, 0.0))
    first.grant(0.0)
    first.done(Done("a", 0, 0.0, overloaded=True, pause_s=3600.0), 0.0)
    clocks = {"clock": lambda: 50.0, "wall_clock": lambda: 9000.0 + later_s}
    second = open_admissions(MODELS, BudgetConfig(), tmp_path, "s2", **clocks)["e"]
    second.wish(Wish("b", 10, 0.0))
    answer = second.grant(50.0)
    assert (answer.granted, answer.wait_s or 0.0) == (() if left_s else ("b",), left_s)


def test_calls_of_an_earlier_session_count_as_spent_and_hold_no_place(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j.jsonl", "s1", wall_clock=lambda: 100.0)
    journal.record(Wish("a", 50, 0.5))
    journal.record(Wish("b", 50, 0.5))
    journal.record(Done("b", 20, 0.2))
    past = Journal(tmp_path / "j.jsonl", "s2", wall_clock=lambda: 130.0).read()
    assert (past.spent.calls, past.spent.tokens, past.spent.usd) == (2, 70, 0.7)
    assert [(call.wish.id, call.age_s, call.tokens, call.same_session) for call in past.calls] == [
        ("a", 30.0, None, False),
        ("b", 30.0, 20, False),
    ]


def test_a_journal_cut_in_a_line_keeps_the_others(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    first = Journal(path, "s")
    first.record(Wish("a", 5, 0.0))
    first.record(Wish("b", 5, 0.0))
    path.write_bytes(path.read_bytes()[:-9])
    second = Journal(path, "s")
    second.record(Wish("c", 5, 0.0))
    assert [call.wish.id for call in second.read().calls] == ["a", "c"]


def test_a_wall_clock_put_back_makes_lines_new_not_future(tmp_path: Path) -> None:
    Journal(tmp_path / "j", "s", wall_clock=lambda: 7200.0).record(Wish("a", 5, 0.0))
    assert Journal(tmp_path / "j", "s", wall_clock=lambda: 3600.0).read().calls[0].age_s == 0.0


def test_calls_with_one_key_go_one_at_a_time_and_hold_no_others_up() -> None:
    gate = admission()
    for wish in (Wish("a", 10, 0.0, "k"), Wish("b", 10, 0.0, "k"), Wish("c", 10, 0.0, "other"), Wish("d", 10, 0.0)):
        gate.wish(wish)
    assert gate.grant(0.0).granted == ("a", "c", "d")
    gate.wish(Wish("b", 10, 0.0, "k"))  # told again
    gate.wish(Wish("e", 10, 0.0))
    assert gate.grant(0.0).granted == ("e",)
    gate.done(Done("a", 10, 0.0), 1.0)
    assert gate.grant(1.0).granted == ("b",)


def test_a_call_that_was_not_sent_never_counted(tmp_path: Path) -> None:
    caps, clock = BudgetConfig(calls=1), {"clock": lambda: 0.0, "wall_clock": lambda: 0.0}
    gate = open_admissions(MODELS, caps, tmp_path, "s1", **clock)["e"]
    gate.wish(Wish("a", 10, 0.0))
    gate.grant(0.0)
    gate.done(Done("a", 0, 0.0, sent=False), 0.0)
    assert gate.window.calls(0.0) == ()
    gate.wish(Wish("b", 10, 0.0))
    assert gate.grant(0.0).granted == ("b",)
    gate.done(Done("b", 10, 0.0), 0.0)
    past = Journal(next(tmp_path.iterdir()), "s2", wall_clock=lambda: 0.0).read()
    assert (past.spent.calls, past.spent.tokens) == (1, 10)


def test_calls_of_a_worker_that_died_are_given_up_when_another_takes_its_place() -> None:
    gate = admission(concurrency=2, caps=BudgetConfig(tokens=1000))
    for wish in (
        Wish("w.1:0", 10, 0.0, "k"),
        Wish("v.1:0", 10, 0.0),
        Wish("w.1:1", 10, 0.0),
        Wish("v.1:1", 10, 0.0, "k"),
    ):
        gate.wish(wish)
    assert gate.grant(0.0).granted == ("w.1:0", "v.1:0")
    gate.replaced("w", "w.2")
    assert gate.budget.spent.tokens == 10, "it may have been answered all the same"
    assert gate.grant(1.0).granted == ("v.1:1",)
    gate.replaced("w", "w.2")
    assert gate.budget.spent.tokens == 10


def test_a_stored_reply_says_what_a_call_used_that_nobody_saw_end(tmp_path: Path) -> None:
    keys = ("0" * 64, "1" * 64)
    first = open_admissions(MODELS, BudgetConfig(), tmp_path / "journals", "s1", tmp_path)["e"]
    for number, key in enumerate(keys):
        first.wish(Wish(str(number), 100, 0.0, key))
    assert first.grant(1e9).granted == ("0",)
    CallCache(tmp_path).put(keys[0], Reply("1", 7, 2))
    second = open_admissions(MODELS, BudgetConfig(), tmp_path / "journals", "s2", tmp_path)["e"]
    assert (second.budget.spent.calls, second.budget.spent.tokens) == (1, 9)
