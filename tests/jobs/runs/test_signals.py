from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from jobs.runs.signals import STOPPED, UNWIND_S, Stopping
from tests.conftest import ROOT


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_first_signal_is_a_wish_and_the_second_breaks_off_where_someone_looks(number: signal.Signals) -> None:
    told: list[str] = []
    before = signal.getsignal(number)
    with Stopping(lambda: told.append("stopping")) as stopping:
        assert not stopping()
        os.kill(os.getpid(), number)
        assert stopping()
        os.kill(os.getpid(), number)
        with pytest.raises(KeyboardInterrupt):
            stopping()
    assert told == ["stopping"]
    assert signal.getsignal(number) == before
    assert stopping._unwinding is not None
    assert stopping._unwinding.finished.is_set(), "a run that unwound is not ended from aside"


def test_second_signal_ends_a_run_that_nobody_looks_after() -> None:
    code = (
        "import sys, time; from jobs.runs.signals import Stopping\n"
        "with Stopping(lambda: print('stopping', flush=True)):\n"
        "    print('up', flush=True)\n"
        "    while True: time.sleep(0.1)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == "stopping\n"
        before = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == STOPPED
        assert time.monotonic() - before < UNWIND_S + 5
