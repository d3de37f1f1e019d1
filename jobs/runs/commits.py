"""From outcomes to committed units: the only place where a run's tables are written, and where a stale driver stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jobs.runs.events import EventLog
from jobs.runs.lock import RunLock
from jobs.runs.spend import CallTotals
from schemas.compaction import Compactor
from schemas.errors import InputError
from schemas.manifest import commit_unit
from schemas.run_folder import RunFolder
from schemas.tables import ALL_TABLES, MAIN_TABLES, item_column
from workers.dispatch import Outcome
from workers.steps import Tables


class Commits:
    """Gathers a unit's outcomes until they are whole, then commits it.

    Args:
        run: The run.
        sizes: Questions, or captures, of each unit, by unit id, in plan order.
        lock: The run's lock, looked at before every commit.
        events: The run's diary.
    """

    def __init__(self, run: RunFolder, sizes: Mapping[str, int], lock: RunLock, events: EventLog) -> None:
        self._run, self._lock, self._events = run, lock, events
        self._gathering: dict[str, list[Tables | None]] = {}
        self._compactor = Compactor(run.root, sizes.items(), epoch=lock.epoch)

    def add(self, outcome: Outcome[Any]) -> int:
        """Take in an outcome; return how many questions are committed by it: those of its unit, or none yet.

        Raises:
            FencedError: Another driver has taken the run.
            StopError: The disk takes no more.
        """
        unit = outcome.unit
        gathered = self._gathering.setdefault(unit.id, [None] * len(unit.items))
        gathered[outcome.position] = _checked(outcome)
        if None in gathered:
            return 0
        rows = _merged(self._gathering.pop(unit.id))
        self._lock.check()
        if not commit_unit(self._run.root, unit.id, rows, epoch=self._lock.epoch).won:
            # Nobody else should have: unless the run has just been taken, it was a driver before this one, woken late.
            self._lock.check()
        told = {"unit": unit.id, "scene": unit.scene, "questions": len(unit.items)}
        self._events.note("committed", **told, calls=CallTotals.of(rows["calls"]).as_event())
        try:
            self._compactor.committed(unit.id)
        except InputError as error:
            # `resume` finds it as well, and does that unit again.
            self._events.note("damaged", message=str(error))
        return len(unit.items)


def _checked(outcome: Outcome[Any]) -> Tables:
    """Return the outcome's tables, sure to hold exactly one answer to the question, or row of the capture, it is of."""
    asked = outcome.unit.item_names[outcome.position]
    found = [getattr(row, item_column(name)) for name in MAIN_TABLES for row in outcome.tables.get(name, ())]
    assert found == [asked], f"{asked} must have one row in one of {', '.join(MAIN_TABLES)}, found {found}"
    return outcome.tables


def _merged(gathered: list[Tables | None]) -> dict[str, list[Any]]:
    """Return a unit's records by table, questions in plan order."""
    merged: dict[str, list[Any]] = {name: [] for name in ALL_TABLES}
    for tables in gathered:
        assert tables is not None
        for name, records in tables.items():
            merged[name].extend(records)
    return merged
