"""The gate a call passes before it is sent: an `Admission` as the callers in one event loop see it.

Callers wait in `enter` until their call may go, and say in `leave` what it cost. The admission may live in this loop or
in another process: a gate talks to it in exchanges, each of which carries all that gathered since the last one, so that
hundreds of calls a second cost a few exchanges; while calls wait, one exchange listens. Every part of an exchange may
be told twice without harm: a gate whose exchange failed, or whose admission was made anew, tells it again, with all
its calls that wait.
"""

from __future__ import annotations

import asyncio
import itertools
import time
import uuid
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from pipeline.models.admission import Admission, Done, Wish
from schemas.errors import RetryError, StopError

LONGEST_WAIT_S = 5.0
"""An exchange without news ends after this long, so that nobody waits for ever on one that got lost."""
GATHER_S = 0.003
"""What is said within this time goes in one exchange: nothing to a call, much to the cost of exchanges."""
AGAIN_S = 0.2
"""Seconds until an exchange that failed is tried again."""


class BudgetError(StopError):
    """A cap of the run is reached: no further call may be sent."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """What a gate tells its admission at one time."""

    gate: str
    """Who speaks; its wishes' ids begin with this and a colon."""
    wishes: tuple[Wish, ...] = ()
    """Its calls that want to go and were not told yet, or not for certain."""
    done: tuple[Done, ...] = ()
    """Its calls that have ended."""
    withdrawn: tuple[str, ...] = ()
    """Its calls that no longer want to go."""
    listen: bool = False
    """Whether it waits for news, `LONGEST_WAIT_S` at most."""
    authority: str = ""
    """Whom it told its wishes so far; empty when nobody."""


@dataclass(slots=True)
class News:
    """What an admission tells a gate."""

    granted: list[str] = field(default_factory=list)
    """Calls that may be sent now."""
    refused: list[tuple[str, str]] = field(default_factory=list)
    """Calls that never may, with the reason."""
    authority: str = ""
    """Who says so; another than before knows nothing of the calls that wait."""

    def __bool__(self) -> bool:
        return bool(self.granted or self.refused)


@runtime_checkable
class Authority(Protocol):
    """Where an admission lives."""

    async def exchange(self, exchange: Exchange) -> News:
        """Take in what a gate tells and return the news for it; one that listens waits for some.

        Raises:
            RetryError: The admission cannot be reached just now.
        """
        ...


class LocalAuthority:
    """An admission in this event loop, for any number of gates.

    Args:
        admission: The admission.
        clock: Monotonic seconds.
    """

    def __init__(self, admission: Admission, clock: Callable[[], float] = time.monotonic) -> None:
        self._admission, self._clock, self._name = admission, clock, uuid.uuid4().hex
        self._news: dict[str, News] = {}
        self._arrived: dict[str, asyncio.Event] = {}
        self._present: dict[str, str] = {}
        self._gone: set[str] = set()

    async def exchange(self, exchange: Exchange) -> News:
        """Take in what a gate tells and return the news for it; one that listens waits for some."""
        admission = self._admission
        if exchange.gate in self._gone:
            return News(authority=self._name)
        self._note(exchange.gate)
        for done in exchange.done:
            admission.done(done, self._clock())
        for wish_id in exchange.withdrawn:
            admission.withdraw(wish_id)
        known = set(self._of(exchange.gate).granted)
        for wish in exchange.wishes:
            if admission.wish(wish) and wish.id not in known:
                self._of(exchange.gate).granted.append(wish.id)  # granted before, in an answer that got lost
        wait_s = self._decide()
        until = self._clock() + LONGEST_WAIT_S
        arrived = self._arrived.setdefault(exchange.gate, asyncio.Event())
        listen = exchange.listen and exchange.authority in ("", self._name)
        while listen and not self._of(exchange.gate) and self._clock() < until:
            arrived.clear()
            left = until - self._clock()
            try:
                await asyncio.wait_for(arrived.wait(), left if wait_s is None else min(left, wait_s))
            except TimeoutError:
                wait_s = self._decide()
        return self._news.pop(exchange.gate, News(authority=self._name))

    def _note(self, gate: str) -> None:
        """Take note of a gate that is heard for the first time: the one that was in its place is gone."""
        place = gate.partition(".")[0]
        before = self._present.get(place)
        if before != gate:
            self._present[place] = gate
            self._admission.replaced(place, gate)
            if before is not None:
                self._gone.add(before)

    def _of(self, gate: str) -> News:
        return self._news.setdefault(gate, News(authority=self._name))

    def _decide(self) -> float | None:
        answer = self._admission.grant(self._clock())
        for wish_id in answer.granted:
            self._of(_gate_of(wish_id)).granted.append(wish_id)
        for wish_id, reason in answer.refused:
            self._of(_gate_of(wish_id)).refused.append((wish_id, reason))
        for gate in {_gate_of(wish_id) for wish_id in (*answer.granted, *(name for name, _ in answer.refused))}:
            if gate in self._arrived:
                self._arrived[gate].set()
        return answer.wait_s


class Gate:
    """Where calls of one event loop wait their turn. Not for several threads.

    Args:
        authority: Who decides.
        place: Name, without dot or colon, of what the gate belongs to, such as a worker that is started again when
            it dies: a later gate with the same place takes over, and calls under way of the earlier one are given
            up. None for a place of its own.
    """

    def __init__(self, authority: Authority, place: str | None = None) -> None:
        unique = uuid.uuid4().hex
        self._authority, self._name, self._told = authority, f"{place or unique}.{unique}", ""
        self._numbers = itertools.count()
        self._waiting: OrderedDict[str, tuple[Wish, asyncio.Future[None]]] = OrderedDict()
        self._new, self._done, self._withdrawn = list[Wish](), list[Done](), list[str]()
        self._telling: asyncio.Task[None] | None = None
        self._listening: asyncio.Task[None] | None = None

    async def enter(self, tokens: int, usd: float = 0.0, key: str = "") -> str:
        """Wait until a call may be sent; return its ticket for `leave`.

        Args:
            tokens: Most tokens it is expected to use.
            usd: What they would cost, US dollars.
            key: What is asked; waits for calls with the same key, of any gate, to end. Empty waits for none.

        Raises:
            BudgetError: A cap of the run is reached.
        """
        wish = Wish(f"{self._name}:{next(self._numbers)}", tokens, usd, key)
        decided: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting[wish.id] = wish, decided
        self._new.append(wish)
        self._tell_soon()
        try:
            await decided
        except asyncio.CancelledError:
            if self._waiting.pop(wish.id, None) is not None:
                self._withdrawn.append(wish.id)
            # It may have been granted meanwhile: then its place is given back unused.
            self.leave(wish.id, 0, sent=False)
            raise
        return wish.id

    def leave(
        self,
        ticket: str,
        tokens: int | None,
        usd: float = 0.0,
        *,
        overloaded: bool = False,
        pause_s: float | None = None,
        sent: bool = True,
    ) -> None:
        """Say how a call ended.

        Args:
            ticket: From `enter`.
            tokens: Tokens used; None when nobody knows, and the estimate stands.
            usd: What they cost.
            overloaded: The server said it has too much to do.
            pause_s: Seconds it asked everyone to wait.
            sent: False where nothing was sent after all.
        """
        self._done.append(Done(ticket, tokens, usd, overloaded, pause_s, sent))
        self._tell_soon()

    async def settled(self) -> None:
        """Wait until all that was said has been heard."""
        while self._new or self._done or self._withdrawn or (self._telling and not self._telling.done()):
            self._tell_soon()
            assert self._telling is not None
            await self._telling

    def _tell_soon(self) -> None:
        if self._telling is None or self._telling.done():
            self._telling = asyncio.get_running_loop().create_task(self._tell())

    async def _tell(self) -> None:
        while self._new or self._done or self._withdrawn:
            await asyncio.sleep(GATHER_S)
            # A call granted meanwhile is not told again: with its end in the same exchange it would count twice.
            new = tuple(wish for wish in self._new if wish.id in self._waiting)
            done, withdrawn = tuple(self._done), tuple(self._withdrawn)
            self._new, self._done, self._withdrawn = [], [], []
            try:
                self._hear(await self._authority.exchange(Exchange(self._name, new, done, withdrawn)))
            except RetryError:
                self._done, self._withdrawn = [*done, *self._done], [*withdrawn, *self._withdrawn]
                self._tell_all()
                await asyncio.sleep(AGAIN_S)
            except Exception as error:
                self._fail(error)
                raise
        if self._waiting and (self._listening is None or self._listening.done()):
            self._listening = asyncio.get_running_loop().create_task(self._listen())

    async def _listen(self) -> None:
        while self._waiting:
            try:
                listening = Exchange(self._name, listen=True, authority=self._told)
                self._hear(await self._authority.exchange(listening))
            except RetryError:
                self._tell_all()
                await asyncio.sleep(AGAIN_S)
            except Exception as error:
                self._fail(error)
                raise

    def _tell_all(self) -> None:
        """Tell again of every call that waits: a grant may have been lost with an answer, or the queue with all."""
        self._new = [wish for wish, _ in self._waiting.values()]
        self._tell_soon()

    def _hear(self, news: News) -> None:
        told, self._told = self._told, news.authority
        if told not in ("", news.authority):
            self._tell_all()
        for wish_id in news.granted:
            if wish_id in self._waiting:
                self._waiting.pop(wish_id)[1].set_result(None)
        for wish_id, reason in news.refused:
            if wish_id in self._waiting:
                self._waiting.pop(wish_id)[1].set_exception(BudgetError(reason))

    def _fail(self, error: Exception) -> None:
        """Give an error nobody foresaw to every caller: none may wait for ever."""
        while self._waiting:
            _, (_, decided) = self._waiting.popitem()
            decided.set_exception(error)


def _gate_of(wish_id: str) -> str:
    return wish_id.rpartition(":")[0]
