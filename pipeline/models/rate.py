"""Requests and tokens per minute: admits a call only when no window of a minute can exceed a limit through it.

A log of the calls of the last minute, rather than a bucket that refills: a bucket of a minute's worth lets nearly two
minutes' worth through in one. A second, short window spreads the requests, since servers measure seconds too. A call
counts with its estimated tokens until its usage is known, and with its usage from then on.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

MINUTE_S = 60.0
ROUNDING_S = 1e-9
"""A call this close to leaving a window has left it: waiting for exactly that moment may round to just before."""


@dataclass(slots=True)
class Admitted:
    """One call that was let through."""

    at_s: float
    """When, on the clock the window is given."""
    tokens: int
    """Estimate, then usage."""


class RateWindow:
    """Counts calls and tokens of one endpoint. The caller brings the clock: monotonic seconds, never going back.

    Args:
        requests: Most calls in any minute; None for no limit.
        tokens: Most tokens in any minute; None for no limit.
        burst_s: Length of the short window, seconds; it may hold its share of the requests of a minute, rounded up.
        slack_s: Time added to every window: what a call may be delayed on its way, so that the server, which counts
            arrivals, sees no more than the limit either.
    """

    def __init__(self, requests: int | None, tokens: int | None, *, burst_s: float = 5.0, slack_s: float = 0.5) -> None:
        self._whole = _Window(MINUTE_S + slack_s, requests, tokens)
        share = None if requests is None else math.ceil(requests * burst_s / MINUTE_S)
        self._short = _Window(burst_s, share, None)

    def wait_s(self, tokens: int, now_s: float) -> float:
        """Return the seconds until a call of this many tokens fits; 0 when it fits now.

        A call estimated above the whole limit fits when nothing else counts: it goes alone.
        """
        return max(self._whole.wait_s(tokens, now_s), self._short.wait_s(tokens, now_s))

    def admit(self, tokens: int, now_s: float) -> Admitted:
        """Count a call from now on; ask `wait_s` first."""
        call = Admitted(now_s, tokens)
        self._whole.add(call)
        self._short.add(call)
        return call

    def settle(self, call: Admitted, tokens: int) -> None:
        """Put a call's usage in the place of its estimate: what was not used is free for others."""
        self._whole.change(call, tokens)
        self._short.change(call, tokens)
        call.tokens = tokens

    def withdraw(self, call: Admitted) -> None:
        """Count a call no longer, since it was not sent."""
        self._whole.drop(call)
        self._short.drop(call)

    def calls(self, now_s: float) -> tuple[Admitted, ...]:
        """Return the calls that still count, oldest first."""
        self._whole.expire(now_s)
        return tuple(self._whole.log)


class _Window:
    """The calls of the last `length_s` seconds and their sums."""

    def __init__(self, length_s: float, requests: int | None, tokens: int | None) -> None:
        self.length_s, self.requests, self.limit = length_s, requests, tokens
        self.log: deque[Admitted] = deque()
        self.sum = 0

    def add(self, call: Admitted) -> None:
        self.log.append(call)
        self.sum += call.tokens

    def change(self, call: Admitted, tokens: int) -> None:
        if self.log and call.at_s >= self.log[0].at_s:  # else it has left the window
            self.sum += tokens - call.tokens

    def drop(self, call: Admitted) -> None:
        for place, found in enumerate(self.log):
            if found is call:
                del self.log[place]
                self.sum -= call.tokens
                return

    def expire(self, now_s: float) -> None:
        while self.log and self.log[0].at_s + self.length_s <= now_s + ROUNDING_S:
            self.sum -= self.log.popleft().tokens

    def wait_s(self, tokens: int, now_s: float) -> float:
        self.expire(now_s)
        free_at = now_s
        if self.requests is not None and len(self.log) >= self.requests:
            free_at = self.log[len(self.log) - self.requests].at_s + self.length_s
        if self.limit is not None and self.log:
            excess = self.sum + min(tokens, self.limit) - self.limit
            for call in self.log:
                if excess <= 0:
                    break
                excess -= call.tokens
                free_at = max(free_at, call.at_s + self.length_s)
        return max(0.0, free_at - now_s)
