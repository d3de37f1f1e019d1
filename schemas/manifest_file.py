"""What a manifest says, and how it becomes a JSON file that notices every changed character.

A unit's manifest names its parts. A block's manifest names the parts that many units share after compaction, and which
rows are whose; read back, it gives one `Manifest` a unit, so no reader cares which kind it came from.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from schemas import storage
from schemas.errors import InputError
from schemas.tables import ALL_TABLES

FORMAT = 2
"""Version of the layout. 1 had neither seal, epoch nor generation, and is still read."""

UNITS = "manifests"
BLOCKS = "blocks"
DISCARDED = "discarded"
"""Folders of a run: units' manifests, blocks' manifests, and records of what does not count any more."""

_ID = re.compile(r"[A-Za-z0-9_-]{1,120}")
_NAME = re.compile(r"([A-Za-z0-9_-]{1,120})(?:\.([1-9][0-9]{0,8}))?\.json")
_PART = re.compile(r"[A-Za-z0-9_-]{1,160}\.parquet")
SEAL = "sha256"
"""Field of a sealed JSON object: hash of everything else in it."""


@dataclass(frozen=True, slots=True)
class PartEntry:
    """One table of a unit: a file, or some rows of a file that units of a block share."""

    path: str
    """Path of the file below the run folder."""
    sha256: str
    """Hash of its bytes."""
    bytes: int
    """Size."""
    rows: int
    """Rows of the unit, at least 1: a table without rows has no part."""
    version: int
    """Table version."""
    first: int = 0
    """Row of the file at which the unit's begin."""
    file_rows: int | None = None
    """Rows of the whole file; None where it holds this unit alone."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """What one unit of work has committed."""

    unit: str
    """Unit id."""
    questions: int
    """Questions in the unit; each has exactly one row in `answers`."""
    statuses: Mapping[str, int]
    """Questions by status."""
    parts: Mapping[str, PartEntry]
    """Parts by table."""
    epoch: int = 0
    """Which driver of the run wrote it, counted from 1; 0 where nobody counted."""
    generation: int = 0
    """How often the unit had been discarded before."""
    format: int = FORMAT
    """Layout version."""


def checked_id(unit: str) -> str:
    """Return a unit id that may stand in a path.

    Raises:
        InputError: It may not: the plan it comes from is not ours.
    """
    if not _ID.fullmatch(unit):
        raise InputError("plan", field="unit", expected="letters, digits, dash and underscore", found=repr(unit[:80]))
    return unit


def numbered_uri(run: str, folder: str, name: str, number: int = 0) -> str:
    """Return where the manifest of a unit's generation, or of a block's version, lies."""
    return storage.join(run, folder, f"{checked_id(name)}.{number}.json" if number else f"{checked_id(name)}.json")


def numbered_names(run: str, folder: str) -> dict[str, list[int]]:
    """Return the numbers of each name in one of the folders, ascending; other files are passed over."""
    found: dict[str, list[int]] = {}
    for name in storage.list_files(storage.join(run, folder)):
        if match := _NAME.fullmatch(name):
            found.setdefault(match[1], []).append(int(match[2] or 0))
    return {name: sorted(numbers) for name, numbers in found.items()}


def sealed(content: Mapping[str, Any]) -> bytes:
    """Return plain data as JSON with a hash of itself in it."""
    plain = json.loads(json.dumps(content, allow_nan=False))
    return json.dumps({**plain, SEAL: _hash(plain)}, indent=1, sort_keys=True, ensure_ascii=False).encode()


def unsealed(data: bytes, subject: object, *, sealed_since: int | None = None) -> dict[str, Any]:
    """Return the plain data of a JSON object after checking its hash, where it has one.

    Args:
        data: The file.
        subject: Where it came from, for messages.
        sealed_since: First value of its field `format` that must have a hash; None where it need not.

    Raises:
        InputError: It is not a JSON object, or not what was written.
    """
    try:
        found = json.loads(data)
    except ValueError as error:
        raise InputError(subject, expected="JSON", found=str(error)) from error
    if not isinstance(found, dict):
        raise InputError(subject, expected="a JSON object", found=type(found).__name__)
    seal, layout = found.pop(SEAL, None), found.get("format")
    if seal is None and sealed_since is not None and isinstance(layout, int) and layout >= sealed_since:
        raise InputError(subject, field=SEAL, expected="a hash", found="none")
    if seal is not None and seal != _hash(found):
        raise InputError(subject, field=SEAL, expected=f"{seal}, as the file says of itself", found=_hash(found))
    return found


def _hash(plain: Mapping[str, Any]) -> str:
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def encode_manifest(manifest: Manifest) -> bytes:
    """Return a unit's manifest as the bytes of its file."""
    content = dataclasses.asdict(manifest)
    content["parts"] = {table: _file_entry(entry) for table, entry in manifest.parts.items()}
    return sealed(content)


def decode_manifest(data: bytes, unit: str, subject: object) -> Manifest:
    """Return the manifest in a unit's file.

    Raises:
        InputError: It is not one, is damaged, or names a table or layout that this version does not know.
    """
    found = _unsealed_format(data, subject)
    try:
        parts = _parts(found.pop("parts"), subject)
        manifest = Manifest(parts=parts, **found)
        numbers = [manifest.questions, manifest.epoch, manifest.generation, *manifest.statuses.values()]
    except (TypeError, KeyError, AttributeError) as error:
        raise InputError(subject, expected="a manifest", found=f"{type(error).__name__}: {error}") from error
    if manifest.unit != unit or not all(isinstance(number, int) for number in numbers):
        raise InputError(subject, expected=f"a manifest of unit {unit}", found=f"one of unit {manifest.unit}")
    return manifest


def encode_block(
    block: str, version: int, epoch: int, parts: Mapping[str, PartEntry], units: Sequence[Manifest]
) -> bytes:
    """Return a block's manifest as the bytes of its file.

    Args:
        block: Block id.
        version: How often the block had been written before.
        epoch: Which driver writes it.
        parts: The shared parts; the rows of each are those of `units`, one after the other.
        units: Manifests of its units before they were merged.
    """
    kept = [
        {
            **{name: getattr(unit, name) for name in ("unit", "questions", "statuses", "epoch", "generation")},
            "rows": {table: entry.rows for table, entry in unit.parts.items()},
        }
        for unit in units
    ]
    files = {table: _file_entry(entry) for table, entry in parts.items()}
    content = {"format": FORMAT, "block": block, "version": version, "epoch": epoch, "parts": files, "units": kept}
    return sealed(content)


def decode_block(data: bytes, block: str, subject: object) -> tuple[Manifest, ...]:
    """Return the manifests of a block's units.

    Raises:
        InputError: As `decode_manifest`.
    """
    found = _unsealed_format(data, subject)
    try:
        files, first, units = _parts(found["parts"], subject), dict.fromkeys(ALL_TABLES, 0), []
        for unit in found["units"]:
            entries = {}
            for table, rows in unit.pop("rows").items():
                whole = files[table]
                if rows < 1:
                    raise ValueError(f"{rows} rows")
                entries[table] = dataclasses.replace(whole, rows=rows, first=first[table], file_rows=whole.rows)
                first[table] += rows
            units.append(Manifest(parts=entries, **unit))
        rows_named = {table: first[table] for table in files}
    except (TypeError, KeyError, AttributeError, ValueError) as error:
        raise InputError(subject, expected="a block's manifest", found=f"{type(error).__name__}: {error}") from error
    if found.get("block") != block or rows_named != {table: entry.rows for table, entry in files.items()}:
        raise InputError(subject, expected=f"block {block} with every row named", found=f"block {found.get('block')}")
    return tuple(units)


def _unsealed_format(data: bytes, subject: object) -> dict[str, Any]:
    found = unsealed(data, subject, sealed_since=2)
    layout = found.get("format")
    if not isinstance(layout, int) or not 1 <= layout <= FORMAT:
        raise InputError(subject, field="format", expected=f"1 to {FORMAT}, or a newer splatreasoner", found=layout)
    return found


def _file_entry(entry: PartEntry) -> dict[str, Any]:
    return {name: getattr(entry, name) for name in ("path", "sha256", "bytes", "rows", "version")}


def _parts(found: Any, subject: object) -> dict[str, PartEntry]:
    """Return the entries of a manifest; a path in one may name nothing but a file in its table's folder."""
    parts = {}
    for table, fields in found.items():
        entry = PartEntry(**fields)
        folder, _, name = entry.path.partition("/")
        if table not in ALL_TABLES or folder != table or not _PART.fullmatch(name):
            expected = f"a part in the folder of one of {', '.join(ALL_TABLES)}"
            raise InputError(subject, field="parts", expected=expected, found=f"{table}: {entry.path!r}")
        parts[table] = entry
    return parts
