"""Waits that end: a watch over the head of a Ray cluster, and bounds on calls that may never return.

When the head of a cluster is gone, Ray's own calls hang for a minute, and then its library ends the process without a
word. When the head is only stuck they hang for ever. So a thread asks the head again and again, and a run whose head
has been silent for a while ends while it can still say why.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType

from schemas.errors import StopError

TICK_S = 1.0
"""Seconds between two questions to the head, and between two looks at how long it has been silent."""

LOST_S = 30.0
"""Silence after which the head counts as lost: half of what Ray gives it before it ends the process."""


class HeadLostError(StopError):
    """The head of the Ray cluster is gone: nothing more can be scheduled."""


class HeadWatch:
    """Watches the head of a cluster, as a context manager.

    Silence is added up tick by tick, so neither a step of the clock nor a pause of this whole process counts as one.

    Args:
        ask: Asks the head something small; may raise, or never return.
        name: What messages call the cluster.
        lost_s: Silence after which it counts as lost, seconds.
        clock: Seconds that only grow.
    """

    def __init__(
        self,
        ask: Callable[[], object],
        name: str,
        *,
        lost_s: float = LOST_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ask, self._name, self._lost_s, self._clock = ask, name, lost_s, clock
        self._silent_s = 0.0
        self._ended = threading.Event()

    @property
    def lost(self) -> bool:
        """Whether the head has been silent for too long."""
        return self._silent_s >= self._lost_s

    def check(self) -> None:
        """Do nothing while the head answers.

        Raises:
            HeadLostError: It has been silent for too long.
        """
        if self.lost:
            raise HeadLostError(f"the head of {self._name} has not answered for {self._silent_s:.0f} s")

    def __enter__(self) -> HeadWatch:
        for target in (self._keep_asking, self._keep_counting):
            threading.Thread(target=target, name="head-watch", daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ended.set()

    def _keep_asking(self) -> None:
        while not self._ended.wait(TICK_S):
            try:
                self._ask()
            except Exception:
                # No answer, whatever the reason: the silence goes on being counted.
                continue
            self._silent_s = 0.0

    def _keep_counting(self) -> None:
        before = self._clock()
        while not self._ended.wait(TICK_S):
            now = self._clock()
            self._silent_s += min(now - before, 2 * TICK_S)
            before = now


def bounded(call: Callable[[], object], seconds: float) -> bool:
    """Return whether a call ended within a time, well or with an error; one that did not is left behind in a thread.

    For calls whose effect is a courtesy, such as telling a cluster that may be gone to end an actor.
    """
    ended = threading.Event()

    def run() -> None:
        try:
            call()
        except Exception:
            # Whether it worked is of no interest once it has ended.
            return
        finally:
            ended.set()

    threading.Thread(target=run, name="bounded", daemon=True).start()
    return ended.wait(seconds)
