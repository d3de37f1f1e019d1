"""What a fault did to a run: how long it took to end, how, and whether its rows are those of a run nothing befell."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

from jobs.runs.submit import RunResult
from schemas.errors import InputError, SplatReasonerError
from schemas.run_folder import RunFolder
from schemas.tables import SAME_EVERY_RUN

OUTPUT = "CHAOS_OUTPUT"
"""Environment variable with the file that gets a line for each fault."""

Rows = dict[str, list[str]]


@dataclass
class Measured:
    """One test's measure of a fault."""

    fault: str
    """The fault, as in `faults.py`."""
    test: str
    """The test, with its parameters."""
    seconds: float | None = None
    """Until the run ended, from when the fault struck or else from its begin; the longest where several ran."""
    exits: list[int] | None = None
    """Exit codes of the runs that were hurt, those that finished them left out."""
    equal: int | None = None
    """Questions whose rows are those of the run that nothing befell."""
    failed: int = 0
    """Questions that end as failed rows, as promised."""
    sent_twice: int | None = None
    """Calls that the server was asked more than once without need; None where no server was asked."""
    note: str = ""
    """What else is promised, in numbers."""

    def __post_init__(self) -> None:
        self._began = time.monotonic()

    def struck(self) -> None:
        """The fault strikes now."""
        self._began = time.monotonic()

    def ended(self, code: int) -> None:
        """The run that was hurt has ended."""
        self.seconds = round(max(self.seconds or 0.0, time.monotonic() - self._began), 1)
        self.exits = [*(self.exits or []), code]

    def run(self, call: Callable[[], RunResult]) -> SplatReasonerError | None:
        """Run in this process; the exit code is the one the command line gives."""
        self.struck()
        try:
            result = call()
        except SplatReasonerError as error:
            self.ended(2 if isinstance(error, InputError) else 1)
            return error
        self.ended(130 if result.driven.stopped else 0)
        return None

    def compare(self, run: str, whole: str | Rows, failed: Mapping[str, str] | None = None) -> None:
        """Compare a run question by question with one that nothing befell.

        Args:
            run: The run that was hurt, and finished.
            whole: The other one, or its rows.
            failed: Questions that may differ, as failed rows, with what their reason begins with.
        """
        found, expected, failed = rows(run), rows(whole) if isinstance(whole, str) else whole, failed or {}
        assert list(found) == list(expected), "each question once, in the order of the plan"
        for name, reason in failed.items():
            (row,) = (row for row in answers(run) if row["question_id"] == name)
            assert row["status"] == "failed"
            assert row["reason"].startswith(reason), row["reason"]
        wrong = {name for name in expected if name not in failed and found[name] != expected[name]}
        assert not wrong, {name: (found[name], expected[name]) for name in sorted(wrong)[:3]}
        self.equal = (self.equal or 0) + len(expected) - len(failed)
        self.failed += len(failed)


def rows(run: str) -> Rows:
    """Return what a run says of each question, in the order of the plan: all of its rows that no clock is in."""
    found: Rows = {question.question_id: [] for unit in RunFolder(run).units() for question in unit.questions}
    for name in SAME_EVERY_RUN:
        for part in RunFolder(run).parts(name):
            for row in part.to_pylist():
                found[row["question_id"]].append(f"{name} {row!r}")
    return found


def answers(run: str) -> list[dict[str, Any]]:
    """Return the rows of the table of answers."""
    return [row for part in RunFolder(run).parts("answers") for row in part.to_pylist()]


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Iterator[Measured]:
    """The measure of the fault that a test's marker `chaos` names; written down when the test ends well."""
    marker = request.node.get_closest_marker("chaos")
    found = Measured(marker.args[0], request.node.nodeid)
    before = request.session.testsfailed
    yield found
    if request.session.testsfailed != before:
        return
    assert found.equal is not None, "a run is compared with one that nothing befell"
    line = json.dumps(asdict(found))
    print(line)
    if output := os.environ.get(OUTPUT):
        with Path(output).open("a") as stream:
            stream.write(line + "\n")
