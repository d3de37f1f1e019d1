"""Reading everything a run holds, and saying what is wrong, by file.

What `resume` mends: damaged parts and manifests, whose units are done again. What nobody can mend but a person: a plan
or a run.json that is not what was written.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jobs.config import checked_job
from jobs.runs.lock import RunLock
from jobs.runs.results import RESULTS
from jobs.stored_replies import contents
from schemas import storage
from schemas.committed import Committed, PartReader
from schemas.errors import InputError
from schemas.manifest_file import BLOCKS, UNITS, Manifest, numbered_names, numbered_uri, unsealed
from schemas.parts import decode_part
from schemas.plan import PLAN_FILE
from schemas.run_folder import RUN_FILE, RunFolder, is_build_run
from schemas.tables import ALL_TABLES, MAIN_TABLES, item_column, table_spec
from workers.dispatch import Unit

KEYED = ("answers", "arms", "clusters", "clusterings", "candidates", "builds")
"""Tables in which a key may stand once; `calls` and `timings` tell what happened, which may happen twice."""


@dataclass(slots=True)
class Verified:
    """What a run folder holds and what is wrong with it."""

    problems: list[str] = field(default_factory=list)
    """What is damaged, each with its file."""
    planned: int = 0
    """Questions in the plan."""
    questions: int = 0
    """Questions whose committed rows are whole and right."""
    units: int = 0
    """Units whose committed rows are whole and right."""
    discarded: int = 0
    """Commits that were taken back, by a retry or for damage."""
    rows: int = 0
    """Rows read."""
    nbytes: int = 0
    """Bytes of the files read."""
    orphans: tuple[str, ...] = ()
    """Files below the run folder that no manifest names: attempts that were cut off or came second. Never read."""
    items: str = "questions"
    """What is planned: questions, or captures of a run that builds scenes; then fields named after questions are about
    captures."""
    replies: int | None = None
    """Stored replies read; None when not asked for."""


def verify_run(run: str | Path, *, calls: bool = False, clean: bool = False) -> Verified:
    """Read everything a run holds.

    Args:
        run: Run folder, a path or URI.
        calls: Also read the stored model replies.
        clean: Remove the orphans. No driver may be at work: what it is about to commit looks like one.

    Raises:
        InputError: There is no such run.
        StopError: Orphans are to be removed while a driver is at work.
    """
    folder = RunFolder(str(run))
    if not folder.exists():
        raise InputError(folder.root, expected=f"a run folder with {RUN_FILE}", found="none")
    if clean:
        with RunLock(folder.root):
            found = _verified(folder, calls)
            for name in found.orphans:
                storage.remove(folder.uri(*name.split("/")))
        return found
    return _verified(folder, calls)


def _verified(folder: RunFolder, calls: bool) -> Verified:
    found = Verified()
    content = _run_file(folder, found)
    _plan(folder, content, found)
    committed = Committed.load(folder.root, strict=False)
    found.problems += [str(error) for _, _, error in committed.unreadable]
    found.discarded = sum(map(len, numbered_names(folder.root, "discarded").values()))
    whole = {m.unit: m for m in _sound_manifests(committed, found)}
    builds = content is not None and is_build_run(content)
    found.items = "captures" if builds else "questions"
    _rows(folder, folder.captures() if builds else folder.units(), whole, found)
    found.orphans = tuple(sorted(_orphans(folder.root, committed, whole)))
    _results(folder, found)
    if calls and content is not None and not builds:
        _replies(folder, content, found)
    # A file that many units share is wrong once.
    found.problems = list(dict.fromkeys(found.problems))
    return found


def _run_file(folder: RunFolder, found: Verified) -> dict[str, Any] | None:
    uri = folder.uri(RUN_FILE)
    try:
        return unsealed(storage.read_bytes(uri), uri)
    except InputError as error:
        found.problems.append(str(error))
        return None


def _plan(folder: RunFolder, content: dict[str, Any] | None, found: Verified) -> None:
    """Compare the plan with the hash that run.json took of it."""
    uri = folder.uri(PLAN_FILE)
    try:
        digest = hashlib.sha256(storage.read_bytes(uri)).hexdigest()
    except InputError as error:
        found.problems.append(str(error))
        return
    plan = (content or {}).get("plan")
    expected = plan.get("sha256") if isinstance(plan, dict) else None
    if expected is not None and digest != expected:
        found.problems.append(f"{uri}: sha256: expected {expected}, as run.json says, found {digest}")


def _sound_manifests(committed: Committed, found: Verified) -> Iterator[Manifest]:
    """Yield the manifests that can be read, those that share files one after the other."""
    for unit in committed.in_order_of_files():
        try:
            yield committed.manifest(unit)
        except InputError as error:
            found.problems.append(str(error))


def _rows(folder: RunFolder, units: Iterator[Unit], whole: dict[str, Manifest], found: Verified) -> None:
    """Read every part of every planned unit and compare its rows with the plan."""
    reader, files, missing = PartReader(folder.root), set[str](), set(whole)
    try:
        for unit in units:
            found.planned += len(unit.items)
            missing.discard(unit.id)
            if unit.id in whole:
                wrong = list(_wrong(reader, unit, whole[unit.id], files, found))
                found.problems += wrong
                found.units += not wrong
                found.questions += 0 if wrong else len(unit.items)
    except InputError as error:
        found.problems.append(str(error))
        return
    for unit_id in sorted(missing):
        found.problems.append(
            f"{numbered_uri(folder.root, UNITS, unit_id)}: expected a unit of the plan, found another"
        )


def _wrong(reader: PartReader, unit: Unit, manifest: Manifest, files: set[str], found: Verified) -> Iterator[str]:
    """Yield what is wrong with a unit's rows."""
    planned = list(unit.item_names)
    for name, entry in manifest.parts.items():
        try:
            table = reader.read(manifest, name)
        except InputError as error:
            yield str(error)
            continue
        found.rows += table.num_rows
        if entry.path not in files:
            files.add(entry.path)
            found.nbytes += entry.bytes
        for message in _compared(name, table, planned, manifest):
            yield f"{entry.path}: unit {unit.id}: {message}"
    if not any(name in manifest.parts for name in MAIN_TABLES):
        yield f"unit {unit.id}: expected a part of {' or '.join(MAIN_TABLES)}, found none"


def _compared(name: str, table: Any, planned: list[str], manifest: Manifest) -> Iterator[str]:
    """Yield how a part differs from what its unit's questions and its manifest lead to."""
    column = item_column(name)
    asked = table.column(column).to_pylist()
    if strangers := sorted(set(asked) - {*planned, ""}):
        yield f"{column}: expected those of the unit, found {strangers[0]!r}"
    if name in KEYED:
        key = table_spec(name).key
        keys = Counter(zip(*(table.column(column).to_pylist() for column in key), strict=True))
        if twice := [values for values, count in keys.items() if count > 1]:
            yield f"{', '.join(key)}: expected each once, found {twice[0]} {keys[twice[0]]} times"
    if name in MAIN_TABLES:
        if asked != planned:
            yield f"{column}: expected one row for each of {len(planned)} planned, found {len(asked)} rows"
        statuses = Counter(table.column("status").to_pylist())
        if statuses != Counter(manifest.statuses) or manifest.questions != len(planned):
            yield f"status: expected {dict(manifest.statuses)}, as the manifest says, found {dict(statuses)}"


def _orphans(run: str, committed: Committed, whole: dict[str, Manifest]) -> Iterator[str]:
    """Yield the files that do not count and that nothing needs."""
    needed = {entry.path for manifest in whole.values() for entry in manifest.parts.values()}
    # Parts of a unit whose manifest is damaged stay: they are evidence until it is done again.
    evidence = {unit for unit in committed.units if unit not in whole} | {block for block, _, _ in committed.unreadable}
    for name in ALL_TABLES:
        for file in storage.list_files(storage.join(run, name)):
            if f"{name}/{file}" not in needed and file.rpartition("-")[0] not in evidence:
                yield f"{name}/{file}"
    for unit, numbers in committed.shadowed.items():
        for number in numbers:
            yield f"{UNITS}/{unit}.{number}.json" if number else f"{UNITS}/{unit}.json"
    for block, versions in numbered_names(run, BLOCKS).items():
        for number in versions:
            if number < committed.blocks[block][0]:
                yield f"{BLOCKS}/{block}.{number}.json" if number else f"{BLOCKS}/{block}.json"
    for place in (UNITS, BLOCKS, "discarded"):
        for file in storage.list_files(storage.join(run, place)):
            if file.endswith(".tmp"):
                yield f"{place}/{file}"


def _results(folder: RunFolder, found: Verified) -> None:
    """Read the final tables, where they have been written."""
    for file in storage.list_files(folder.uri(RESULTS)):
        name, _, kind = file.rpartition(".")
        if name in ALL_TABLES and kind == "parquet":
            uri = folder.uri(RESULTS, file)
            try:
                decode_part(table_spec(name), storage.read_bytes(uri), uri)
            except InputError as error:
                found.problems.append(f"{error} (written again by: splatreasoner aggregate {folder.root})")


def _replies(folder: RunFolder, content: dict[str, Any], found: Verified) -> None:
    """Read the stored replies."""
    config = content.get("config")
    stored = {**config, "output": folder.root} if isinstance(config, dict) else {}
    place = Path(checked_job(stored, folder.uri(RUN_FILE)).calls_folder())
    if not place.exists():
        found.replies = 0
        return
    calls = contents(place)
    found.replies = sum(count.replies for count in calls.counts.values())
    found.problems += [f"{path}: expected a stored reply, found a damaged one" for path in calls.damaged]
