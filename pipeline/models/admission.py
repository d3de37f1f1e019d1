"""Who may send a call to an endpoint, and when: rates, concurrency, pauses and caps, for everyone who uses it.

One `Admission` decides for a whole run, wherever its callers are: it takes wishes in the order they come and says which
may go now. It knows nothing of threads, processes or event loops and brings no clock, so a minute can be simulated in
a millisecond. What it let through and what that cost goes to a journal before anyone hears of it, so that an admission
that is killed and made anew holds the same limits.
"""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.models.budget import Budget
from pipeline.models.rate import Admitted, RateWindow


@dataclass(frozen=True, slots=True)
class Wish:
    """A call someone wants to send."""

    id: str
    """Unique among all callers and all tries: asked twice, it counts once. Up to its last colon it names who asks."""
    tokens: int
    """Most tokens it is expected to use, prompt and reply."""
    usd: float
    """What that would cost, US dollars."""
    key: str = ""
    """What is asked: of calls with the same key one goes at a time, so that the others can find its reply. Empty for
    a call that is like no other."""


@dataclass(frozen=True, slots=True)
class Done:
    """What became of a call that was let through."""

    id: str
    """Its wish."""
    tokens: int | None
    """Tokens the server counted; None when it did not say, and the estimate stands."""
    usd: float
    """What those cost; ignored when tokens is None."""
    overloaded: bool = False
    """The server asked everyone to slow down."""
    pause_s: float | None = None
    """For how long, seconds; None when it did not say."""
    sent: bool = True
    """False where nothing was sent: then it never counted."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What an `Admission` says to its callers at one moment."""

    granted: tuple[str, ...]
    """Wishes that may be sent now."""
    refused: tuple[tuple[str, str], ...]
    """Wishes that a cap forbids for good, with the reason."""
    wait_s: float | None
    """Seconds until it is worth asking again; None: not before a call is done."""


class Concurrency:
    """Calls under way at once: halved when the server is overloaded, one more after every round that went well.

    Args:
        most: Upper bound, and the first value.
    """

    def __init__(self, most: int) -> None:
        self.most, self.limit = most, float(most)
        self._cut_at = -1.0

    def overloaded(self, sent_s: float, now_s: float) -> None:
        """Halve, once for all calls that were sent before the last time."""
        if sent_s > self._cut_at:
            self.limit, self._cut_at = max(1.0, self.limit / 2), now_s

    def went_well(self) -> None:
        """Grow by one after as many calls as may be under way."""
        self.limit = min(float(self.most), self.limit + 1.0 / self.limit)


@dataclass(slots=True)
class _UnderWay:
    wish: Wish
    call: Admitted


class Admission:
    """Grants the calls of one endpoint, first come first served.

    Args:
        window: Requests and tokens per minute.
        concurrency: Calls under way.
        budget: Caps of the run; shared by its endpoints.
        lost_after_s: A call under way for longer counts as lost with its process: its place is free again and its
            estimate counts as spent.
        record: Journal; called before a wish is granted and when it is done.
        answered: Says what a call cost whose process was lost, where its reply is stored all the same.
    """

    def __init__(
        self,
        window: RateWindow,
        concurrency: Concurrency,
        budget: Budget,
        *,
        lost_after_s: float,
        record: Callable[[Wish | Done], None] = lambda entry: None,
        answered: Callable[[Wish], Done | None] = lambda wish: None,
    ) -> None:
        self.window, self.concurrency, self.budget = window, concurrency, budget
        self._lost_after_s, self._record, self._answered = lost_after_s, record, answered
        self._waiting: OrderedDict[str, Wish] = OrderedDict()
        self._under_way: OrderedDict[str, _UnderWay] = OrderedDict()
        self._keys: set[str] = set()
        self._same: defaultdict[str, OrderedDict[str, Wish]] = defaultdict(OrderedDict)
        self._paused_until = float("-inf")

    def wish(self, wish: Wish) -> bool:
        """Put a call in the queue, where it is not there yet; return whether it is under way already."""
        if wish.id in self._under_way:
            return True
        if wish.id not in self._same.get(wish.key, ()):
            self._waiting.setdefault(wish.id, wish)
        return False

    def withdraw(self, wish_id: str) -> None:
        """Take a call out of the queue, if it is in it."""
        self._waiting.pop(wish_id, None)
        for waiting in self._same.values():
            waiting.pop(wish_id, None)

    def replaced(self, place: str, gate: str) -> None:
        """Give up the calls of a process that died: another one is in its place.

        Args:
            place: What the names of its gates begin with, up to a dot.
            gate: The gate that is there now.
        """
        mine = [i for i in self._under_way if i.startswith(f"{place}.") and not i.startswith(f"{gate}:")]
        for wish_id in mine:
            self._lose(wish_id)
        for waiting in (self._waiting, *self._same.values()):
            for wish_id in [i for i in waiting if i.startswith(f"{place}.") and not i.startswith(f"{gate}:")]:
                del waiting[wish_id]

    def done(self, done: Done, now_s: float) -> None:
        """Note the end of a call; one that is not under way is passed over."""
        ended = self._under_way.pop(done.id, None)
        if ended is None:
            return
        self._record(done)
        self._free(ended.wish.key)
        if not done.sent:
            self.window.withdraw(ended.call)
            self.budget.release(ended.wish.tokens, ended.wish.usd)
            return
        tokens, usd = (ended.wish.tokens, ended.wish.usd) if done.tokens is None else (done.tokens, done.usd)
        self.window.settle(ended.call, tokens)
        self.budget.settle(ended.wish.tokens, ended.wish.usd, tokens, usd)
        if done.overloaded:
            self.concurrency.overloaded(ended.call.at_s, now_s)
        else:
            self.concurrency.went_well()
        if done.pause_s is not None:
            self.pause(done.pause_s, now_s)

    def pause(self, seconds: float, now_s: float) -> None:
        """Grant nothing for some time."""
        self._paused_until = max(self._paused_until, now_s + seconds)

    def restore(self, wish: Wish, at_s: float, tokens: int | None, *, under_way: bool) -> None:
        """Count a call that an earlier admission let through; in the order they were sent, before any is granted.

        Args:
            wish: The call.
            at_s: When it was sent.
            tokens: What it used; None where nobody knows.
            under_way: Whether it may still be: then it holds a place and its estimate stays set aside.
        """
        if under_way:
            self._start(wish, at_s)
        else:
            self.window.admit(wish.tokens if tokens is None else tokens, at_s)

    def grant(self, now_s: float) -> Answer:
        """Let through as many waiting calls as may go now, in order."""
        self._give_up_lost(now_s)
        granted, refused = list[str](), list[tuple[str, str]]()
        wait_s: float | None = None
        while self._waiting:
            wish = next(iter(self._waiting.values()))
            if wish.key in self._keys:
                self._same[wish.key][wish.id] = self._waiting.pop(wish.id)
                continue
            if self.budget.lacks(wish.tokens, wish.usd, reserved=True):
                final = self.budget.lacks(wish.tokens, wish.usd, reserved=False)
                if not final:
                    break  # a call under way may use less than was set aside for it
                refused.append((wish.id, final))
                del self._waiting[wish.id]
                continue
            if len(self._under_way) >= int(self.concurrency.limit):
                wait_s = self._next_loss_s(now_s)
                break
            wait_s = max(self._paused_until - now_s, self.window.wait_s(wish.tokens, now_s))
            if wait_s > 0:
                break
            self._record(wish)
            del self._waiting[wish.id]
            self._start(wish, now_s)
            granted.append(wish.id)
            wait_s = None
        return Answer(tuple(granted), tuple(refused), wait_s)

    def _start(self, wish: Wish, at_s: float) -> None:
        self._under_way[wish.id] = _UnderWay(wish, self.window.admit(wish.tokens, at_s))
        self.budget.reserve(wish.tokens, wish.usd)
        if wish.key:
            self._keys.add(wish.key)

    def _free(self, key: str) -> None:
        """Let the calls that waited for one with this key go on, before all others: they have waited longest."""
        self._keys.discard(key)
        for wish in reversed(self._same.pop(key, OrderedDict()).values()):
            self._waiting[wish.id] = wish
            self._waiting.move_to_end(wish.id, last=False)

    def _lose(self, wish_id: str) -> None:
        lost = self._under_way.pop(wish_id)
        tokens, usd = lost.wish.tokens, lost.wish.usd
        done = self._answered(lost.wish)
        if done is not None and done.tokens is not None:
            self._record(done)
            tokens, usd = done.tokens, done.usd
        self.window.settle(lost.call, tokens)
        self.budget.settle(lost.wish.tokens, lost.wish.usd, tokens, usd)
        self._free(lost.wish.key)

    def _give_up_lost(self, now_s: float) -> None:
        while self._under_way and self._next_loss_s(now_s) <= 0:
            self._lose(next(iter(self._under_way)))

    def _next_loss_s(self, now_s: float) -> float:
        oldest = next(iter(self._under_way.values()))
        return oldest.call.at_s + self._lost_after_s - now_s
