"""Ctrl-C and SIGTERM as a wish to stop: first politely, then at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

CAUGHT = (signal.SIGINT, signal.SIGTERM)


class Stopping:
    """Whether a run was asked to stop, as a context manager that catches the signals.

    The first signal is a wish, looked up by calling this object; the second breaks the run off. In another thread
    than the main one nothing is caught: Python handles signals there only, and whoever called owns them.

    Args:
        told: Called once, when the first signal comes.
    """

    def __init__(self, told: Callable[[], None]) -> None:
        self._told = told
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Return whether a run was asked to stop."""
        return self._asked

    def __enter__(self) -> Stopping:
        self._before = {number: signal.getsignal(number) for number in CAUGHT}
        self.catch()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._in_main_thread():
            for number, handler in self._before.items():
                signal.signal(number, handler)

    def catch(self) -> None:
        """Put the handlers in place, again where a library has put its own: Ray does when it starts."""
        if self._in_main_thread():
            for number in CAUGHT:
                signal.signal(number, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
        self._told()

    @staticmethod
    def _in_main_thread() -> bool:
        return threading.current_thread() is threading.main_thread()
