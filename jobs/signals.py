"""Ctrl-C and SIGTERM as a wish to stop: first politely, then at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class Stopping:
    """Whether a run was asked to stop."""

    def __init__(self, told: Callable[[], None]) -> None:
        self._told = told
        self.asked = False

    def __call__(self) -> bool:
        """Return whether it was."""
        return self.asked

    def ask(self) -> None:
        """Ask; the first time the caller is told, the second time the run is broken off."""
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        self._told()


@contextmanager
def stop_on_signals(told: Callable[[], None]) -> Iterator[Stopping]:
    """Catch SIGINT and SIGTERM for a block.

    Args:
        told: Called once, when the first one comes.
    """
    stopping = Stopping(told)
    if threading.current_thread() is not threading.main_thread():
        # Python handles signals in the main thread only; whoever called from elsewhere owns them.
        yield stopping
        return

    def handle(number: int, frame: FrameType | None) -> None:
        stopping.ask()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
