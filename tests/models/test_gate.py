"""Gates: callers wait their turn, several gates share one admission, lost exchanges cost nothing."""

from __future__ import annotations

import asyncio

import pytest

from pipeline.models.admission import Admission, Concurrency, Wish
from pipeline.models.budget import Budget, BudgetConfig
from pipeline.models.gate import BudgetError, Exchange, Gate, LocalAuthority, News
from pipeline.models.rate import RateWindow
from schemas.errors import RetryError
from tests.models.simulated_loop import now_s, simulate


def authority(
    *,
    requests: int | None = None,
    concurrency: int = 100,
    caps: BudgetConfig | None = None,
    lost_after_s: float = 100.0,
) -> LocalAuthority:
    budget = Budget(caps or BudgetConfig())
    admission = Admission(RateWindow(requests, None), Concurrency(concurrency), budget, lost_after_s=lost_after_s)
    return LocalAuthority(admission, clock=now_s)


class Flaky:
    """Loses every third exchange before it arrives and every third answer."""

    def __init__(self, inner: LocalAuthority) -> None:
        self.inner, self.count = inner, 0

    async def exchange(self, exchange: Exchange) -> News:
        self.count += 1
        if self.count % 3 == 0:
            raise RetryError("the admission is gone")
        news = await self.inner.exchange(exchange)
        if self.count % 3 == 1:
            raise RetryError("the answer got lost")
        return news


def test_calls_through_four_gates_share_one_rate() -> None:
    async def main() -> list[float]:
        shared, times = authority(requests=60), list[float]()

        async def call(gate: Gate) -> None:
            ticket = await gate.enter(10)
            times.append(now_s())
            await asyncio.sleep(0.3)
            gate.leave(ticket, 10)

        gates = [Gate(shared) for _ in range(4)]
        await asyncio.gather(*(call(gates[number % 4]) for number in range(240)))
        return sorted(times)

    times = simulate(main())
    assert max(sum(1 for t in times if s <= t < s + 60) for s in times) <= 60
    assert times[-1] <= 240 / (0.95 * 60) * 60


def test_no_more_calls_are_under_way_than_allowed() -> None:
    async def main() -> int:
        shared, now, most = authority(concurrency=3), 0, 0

        async def call(gate: Gate) -> None:
            nonlocal now, most
            ticket = await gate.enter(1)
            now += 1
            most = max(most, now)
            await asyncio.sleep(1.0)
            now -= 1
            gate.leave(ticket, 1)

        gates = [Gate(shared), Gate(shared)]
        await asyncio.gather(*(call(gates[number % 2]) for number in range(30)))
        return most

    assert simulate(main()) == 3


def test_lost_exchanges_and_answers_neither_lose_nor_double_a_call() -> None:
    async def main() -> tuple[int, int]:
        inner = authority(concurrency=2, caps=BudgetConfig(calls=50))
        gate, done = Gate(Flaky(inner)), 0

        async def call() -> None:
            nonlocal done
            ticket = await gate.enter(1)
            await asyncio.sleep(0.1)
            gate.leave(ticket, 1)
            done += 1

        await asyncio.gather(*(call() for _ in range(50)))
        await gate.settled()
        return done, inner._admission.budget.spent.calls

    assert simulate(main()) == (50, 50)


def test_enter_at_a_cap_raises_and_says_which() -> None:
    async def main() -> None:
        gate = Gate(authority(caps=BudgetConfig(calls=1)))
        gate.leave(await gate.enter(1), 1)
        await gate.settled()
        with pytest.raises(BudgetError, match="1 of 1 calls"):
            await gate.enter(1)

    simulate(main())


def test_a_cancelled_wait_gives_up_its_turn() -> None:
    async def main() -> float:
        gate = Gate(authority(concurrency=1))
        first = await gate.enter(1)
        waiting = asyncio.ensure_future(gate.enter(1))
        await asyncio.sleep(1)
        waiting.cancel()
        third = asyncio.ensure_future(gate.enter(1))
        await asyncio.sleep(1)
        gate.leave(first, 1)
        await third
        return now_s()

    assert simulate(main()) == pytest.approx(2.0, abs=0.01)


def test_a_pause_the_server_asked_for_holds_calls_of_every_gate() -> None:
    async def main() -> float:
        shared = authority()
        one, other = Gate(shared), Gate(shared)
        one.leave(await one.enter(1), 0, overloaded=True, pause_s=30.0)
        await one.settled()
        await other.enter(1)
        return now_s()

    assert simulate(main()) == pytest.approx(30.0, abs=0.01)


def test_places_of_a_gate_that_died_are_free_after_its_calls_must_have_ended() -> None:
    async def main() -> float:
        shared = authority(concurrency=1, lost_after_s=60.0)
        await Gate(shared).enter(1)  # and is never heard of again
        await Gate(shared).enter(1)
        return now_s()

    assert simulate(main()) == pytest.approx(60.0, abs=0.01)


def test_a_gate_in_the_place_of_one_that_died_goes_on_at_once() -> None:
    async def main() -> tuple[float, News]:
        shared = authority(concurrency=1, lost_after_s=60.0)
        dead = Gate(shared, "worker-1")
        await dead.enter(1, key="k")
        reborn = Gate(shared, "worker-1")
        await reborn.enter(1, key="k")
        late = await shared.exchange(Exchange(dead._name, (Wish(f"{dead._name}:9", 1, 0.0),)))
        return now_s(), late

    at, late = simulate(main())
    assert at < 1.0
    assert not late, "what arrives late from the dead one is not heard"


class Restarted:
    """An admission that is made anew, without its queue, the moment a number of wishes is in it."""

    def __init__(self, wishes: int, *, told: bool) -> None:
        self.inner, self.wishes, self.told, self.count = authority(concurrency=1), wishes, told, 0

    async def exchange(self, exchange: Exchange) -> News:
        self.count += len(exchange.wishes)
        if self.wishes and self.count >= self.wishes and exchange.listen:
            self.wishes, self.inner = 0, authority(concurrency=1)
            if self.told:
                raise RetryError("the admission is gone")
        return await self.inner.exchange(exchange)


@pytest.mark.parametrize("told", [True, False])
def test_calls_that_wait_are_told_to_an_admission_made_anew(told: bool) -> None:
    async def main() -> tuple[int, float]:
        shared = Restarted(5, told=told)
        gate = Gate(shared)

        async def call() -> None:
            ticket = await gate.enter(1)
            await asyncio.sleep(0.1)
            gate.leave(ticket, 1)

        async with asyncio.timeout(60.0):
            await asyncio.gather(*(call() for _ in range(5)))
        return shared.wishes, now_s()

    left, seconds = simulate(main())
    assert left == 0
    assert seconds < 1.5, "nobody waited for a listening exchange to end by itself"


def test_a_wish_is_told_once_however_long_it_waits() -> None:
    async def main() -> int:
        shared = Restarted(0, told=False)
        gate = Gate(shared)

        async def call() -> None:
            ticket = await gate.enter(1)
            await asyncio.sleep(1.0)
            gate.leave(ticket, 1)

        await asyncio.gather(*(call() for _ in range(40)))
        return shared.count

    assert simulate(main()) == 40
