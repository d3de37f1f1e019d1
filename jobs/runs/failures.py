"""Why questions, or captures, failed, by their own rows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from schemas.committed import Committed, PartReader
from schemas.errors import InputError
from schemas.manifest import Manifest
from schemas.tables import MAIN_TABLES, item_column

FAILED = "failed"
UNREADABLE = "rows that cannot be read"
"""What stands for the error of questions whose part is damaged."""

_REASON = re.compile(r"(?:evidence: )?([A-Za-z_]\w*): (.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Failure:
    """Questions that failed by one kind of error."""

    error: str
    """Class name of the error, or the reason itself where it names none; what `retry --error` takes."""
    message: str
    """What it said most often."""
    questions: int
    """Questions that failed so."""
    example: str
    """Id of one of them, with that message."""


@dataclass(frozen=True, slots=True)
class Ended:
    """A question that failed."""

    item: str
    """Its id."""
    error: str
    """As in `Failure`."""
    message: str
    """What the error said; empty where the reason names no error."""


def error_of(reason: str) -> tuple[str, str]:
    """Return the class name of the error that a row's reason tells, and its message; the reason where it names none."""
    found = _REASON.fullmatch(reason)
    return (found[1], found[2]) if found else (reason, "")


def by_error(ended: Iterable[Ended]) -> tuple[Failure, ...]:
    """Return failures, the most frequent error first."""
    kinds: dict[str, Counter[str]] = {}
    examples: dict[tuple[str, str], str] = {}
    for one in ended:
        kinds.setdefault(one.error, Counter())[one.message] += 1
        examples.setdefault((one.error, one.message), one.item)
    found = []
    for error, messages in kinds.items():
        message = messages.most_common(1)[0][0]
        found.append(Failure(error, message, messages.total(), examples[error, message]))
    return tuple(sorted(found, key=lambda failure: -failure.questions))


class FailedRows:
    """The failed questions of a run's committed units. Kept by who looks again and again: a unit is read once.

    Args:
        run: Run folder.
    """

    def __init__(self, run: str) -> None:
        self._run = run
        self._known: dict[tuple[str, int], tuple[Ended, ...]] = {}

    def read(self, committed: Committed, units: Collection[str]) -> Iterator[Ended]:
        """Yield the failed questions of units; only those are opened that have any and were not seen before."""
        reader, known = PartReader(self._run), self._known
        self._known = {}
        for unit in committed.in_order_of_files():
            if unit in units and (manifest := committed.manifest(unit)).statuses.get(FAILED):
                key = unit, manifest.generation
                self._known[key] = known[key] if key in known else tuple(_failed(committed, reader, manifest))
                yield from self._known[key]


def _failed(committed: Committed, reader: PartReader, manifest: Manifest) -> Iterator[Ended]:
    main = next(name for name in MAIN_TABLES if name in manifest.parts)
    column = item_column(main)
    try:
        rows = committed.read(reader, manifest.unit, main, (column, "status", "reason")).to_pylist()
    except InputError as error:
        yield from [Ended("", UNREADABLE, str(error))] * manifest.statuses[FAILED]
        return
    for row in rows:
        if row["status"] == FAILED:
            yield Ended(row[column], *error_of(row["reason"]))
