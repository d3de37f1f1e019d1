"""Ctrl-C and SIGTERM as a wish to stop: first politely, then at once."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

CAUGHT = (signal.SIGINT, signal.SIGTERM)

UNWIND_S = 3.0
"""Seconds that a run which is broken off gets to take leave of its workers; whatever it does, nothing is lost."""

STOPPED = 130
"""Exit code of a run that a signal ended."""


class Stopping:
    """Whether a run was asked to stop, as a context manager that catches the signals.

    The first signal is a wish, looked up by calling this object; the second makes that call raise KeyboardInterrupt,
    and ends the process where nobody looks in time. Nothing is raised at once, since an interrupt in the middle of a
    compiled function would look like that question's own error. In another thread than the main one nothing is caught:
    Python handles signals there only, and whoever called owns them.

    Args:
        told: Called once, when the first signal comes.
    """

    def __init__(self, told: Callable[[], None]) -> None:
        self._told = told
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}
        self._unwinding: threading.Timer | None = None

    def __call__(self) -> bool:
        """Return whether a run was asked to stop.

        Raises:
            KeyboardInterrupt: It was asked a second time.
        """
        if self._unwinding is not None:
            raise KeyboardInterrupt
        return self._asked

    def __enter__(self) -> Stopping:
        self._before = {number: signal.getsignal(number) for number in CAUGHT}
        self.catch()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._unwinding is not None:
            self._unwinding.cancel()
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
            if self._unwinding is None:
                self._unwinding = threading.Timer(UNWIND_S, os._exit, (STOPPED,))
                self._unwinding.daemon = True
                self._unwinding.start()
            return
        self._asked = True
        self._told()

    @staticmethod
    def _in_main_thread() -> bool:
        return threading.current_thread() is threading.main_thread()
