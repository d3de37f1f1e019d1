"""Making questions that ended badly pending again, so that `resume` does them.

A unit is committed as a whole, so a question is done again with its unit. The others of the unit come out as they were:
their model calls are found among the stored replies, and all else is deterministic. Only a job with `cache: off` pays
for them again.

A failed call leaves no stored reply. An unreadable one does, and would be read the same way again: those of the chosen
questions are forgotten first. Both steps may be cut short at any point and done again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jobs.runs.events import EventLog
from jobs.runs.failures import error_of
from jobs.runs.lock import RunLock
from schemas import storage
from schemas.committed import Committed, PartReader
from schemas.errors import InputError
from schemas.manifest import Manifest, discard_unit
from schemas.run_folder import RunFolder
from schemas.tables import MAIN_TABLES, item_column

RETRIED = ("failed", "unparsed")
"""Statuses that can be made pending again; a skipped question would be skipped again by the same stored reply."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """A unit that holds questions to do again."""

    manifest: Manifest
    """The unit as it was looked at."""
    questions: tuple[str, ...]
    """Ids of the chosen ones."""
    unreadable: tuple[str, ...]
    """Keys of their calls whose reply could not be read."""


@dataclass(frozen=True, slots=True)
class Retried:
    """What was, or would be, made pending."""

    units: int
    """Units."""
    questions: int
    """Questions that were asked for."""
    others: int
    """Other questions of those units, which are done again with them."""
    forgotten: int
    """Stored replies that could not be read and were removed; with `dry_run` those that would be looked for."""
    stored: bool
    """Whether the run stores replies: if not, calls of the others are paid again."""


def retry(
    run: str | Path,
    *,
    error: str = "",
    status: str = "",
    stage: str = "",
    dry_run: bool = False,
    told: Callable[[str], None] = lambda text: None,
) -> Retried:
    """Make questions of a run pending again.

    Args:
        run: Run folder, a path or URI.
        error: Class name of the error that failed ones record, such as RateLimitError; empty for any.
        status: failed or unparsed; empty means failed, and then `error` must be given.
        stage: Only those with a model call of this stage that ended so; empty for all.
        dry_run: Only look.
        told: Called with a text when something takes a while.

    Raises:
        InputError: There is no such run, a part is damaged, or no question that ended so is of this error or stage.
        StopError: A driver is at work on the run.
    """
    status = _checked_status(run, error, status)
    folder = RunFolder(str(run))
    config = folder.read_run().get("config")
    calls = config if isinstance(config, dict) else {}
    stored = calls.get("cache", "on") != "off"
    if dry_run:
        return _summed(list(_choose(folder.root, status, error, stage)), stored, None)
    with RunLock(folder.root, told) as lock:
        chosen = list(_choose(folder.root, status, error, stage))
        forgotten = _forget(folder, calls, chosen)
        events = EventLog(folder.root)
        reason = " ".join(["retry", status, *filter(None, (error, stage))])
        try:
            for one in chosen:
                lock.check()
                unit, generation = one.manifest.unit, one.manifest.generation
                discard_unit(folder.root, unit, epoch=lock.epoch, reason=reason, generation=generation)
                events.note("discarded", unit=unit, reason=reason, redone=one.questions)
        finally:
            events.close()
    return _summed(chosen, stored, forgotten)


def _checked_status(run: str | Path, error: str, status: str) -> str:
    if not error and not status:
        raise InputError(run, expected="an error or a status to retry, such as --status failed", found="neither")
    if status and status not in RETRIED:
        raise InputError(run, field="status", expected=f"one of {', '.join(RETRIED)}", found=status)
    if error and status not in ("", "failed"):
        raise InputError(run, field="error", expected="no error: only failed questions record one", found=error)
    return status or "failed"


def _choose(run: str, status: str, error: str, stage: str) -> Iterator[Chosen]:
    """Yield the units with questions that match.

    Raises:
        InputError: Questions ended so, but none with this error or stage.
    """
    errors, stages, matched = Counter[str](), Counter[str](), False
    committed, reader = Committed.load(run), PartReader(run)
    for unit in committed.in_order_of_files():
        manifest = committed.manifest(unit)
        if not manifest.statuses.get(status):
            continue
        main = next(name for name in MAIN_TABLES if name in manifest.parts)
        column = item_column(main)
        rows = reader.read(manifest, main, (column, "status", "reason")).to_pylist()
        ended = {row[column]: error_of(row["reason"])[0] for row in rows if row["status"] == status}
        calls = _bad_calls(reader, manifest, ended, status) if stage or status == "unparsed" else {}
        if status == "failed":
            errors.update(ended.values())
        for rows in calls.values():
            stages.update({row["stage"] for row in rows})
        names = [
            name
            for name, kind in ended.items()
            if error.lower() in ("", kind.lower()) and (not stage or stage in {row["stage"] for row in calls[name]})
        ]
        if names:
            matched = True
            unreadable = dict.fromkeys(row["key"] for name in names for row in calls.get(name, ()))
            yield Chosen(manifest, tuple(names), tuple(unreadable) if status == "unparsed" else ())
    if matched:
        return
    if error and errors and error.lower() not in map(str.lower, errors):
        raise InputError(run, field="error", expected=f"one of {_counted(errors)}", found=error)
    if stage and (errors or stages):
        expected = f"one of {_counted(stages)}" if stages else "no stage: no model call of these questions ended so"
        raise InputError(run, field="stage", expected=expected, found=stage)


def _bad_calls(
    reader: PartReader, manifest: Manifest, ended: Mapping[str, str], status: str
) -> dict[str, list[dict[str, Any]]]:
    """Return, for each question that ended badly, its calls that ended the same way."""
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in ended}
    columns = ("question_id", "stage", "outcome", "key")
    for row in reader.read(manifest, "calls", columns).to_pylist():
        wanted = "unparsed" if status == "unparsed" else ended.get(row["question_id"])
        if row["question_id"] in found and row["outcome"] == wanted:
            found[row["question_id"]].append(row)
    return found


def _forget(folder: RunFolder, config: Mapping[str, Any], chosen: list[Chosen]) -> int:
    """Remove the stored replies that could not be read; return how many there were."""
    keys = list(dict.fromkeys(key for one in chosen for key in one.unreadable))
    where = storage.local_path(str(config.get("calls") or folder.uri("calls")))
    if not keys or where is None or not where.is_dir():
        return 0
    from pipeline.models.cache import CallCache

    cache = CallCache(where)
    cache.restore()  # else the log of a process that was killed would bring them back
    paths = [path for path in map(cache.path, keys) if path.exists()]
    for path in paths:
        path.unlink(missing_ok=True)
    return len(paths)


def _summed(chosen: list[Chosen], stored: bool, forgotten: int | None) -> Retried:
    questions = sum(len(one.questions) for one in chosen)
    return Retried(
        units=len(chosen),
        questions=questions,
        others=sum(one.manifest.questions for one in chosen) - questions,
        forgotten=sum(len(one.unreadable) for one in chosen) if forgotten is None else forgotten,
        stored=stored,
    )


def _counted(counts: Counter[str]) -> str:
    return ", ".join(
        f"{name} ({count})" for name, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    )
