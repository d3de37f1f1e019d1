"""The commit: parts first, then the unit's manifest, and the manifest is the commit.

Manifests are put where nothing lies, so of several drivers that finish the same unit one wins, for good, and what the
others wrote is never read. Nothing that counts is overwritten or removed to take it back: `discard_unit` puts a record
beside it, and the next commit is another generation. The argument is in docs/decisions/0007-commit.md.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from schemas import storage
from schemas.committed import Committed, PartReader
from schemas.errors import InputError
from schemas.manifest_file import (
    BLOCKS,
    DISCARDED,
    UNITS,
    Manifest,
    PartEntry,
    checked_id,
    decode_manifest,
    encode_manifest,
    numbered_uri,
    sealed,
)
from schemas.parts import encode_part
from schemas.table import TableSpec
from schemas.tables import MAIN_TABLES, table_spec

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "Commit",
    "Damaged",
    "Manifest",
    "PartEntry",
    "all_manifests",
    "commit_unit",
    "committed_units",
    "damage",
    "damaged_units",
    "discard_unit",
    "load_manifest",
    "manifest_uri",
    "read_part",
    "write_part",
]


@dataclass(frozen=True, slots=True)
class Commit:
    """How a commit ended."""

    won: bool
    """Whether the rows given are the ones that count; if not, somebody else committed the unit first. A driver so late
    that the unit has been merged meanwhile is told True too, and what it wrote is not read."""
    manifest: Manifest
    """The manifest that counts."""


@dataclass(frozen=True, slots=True)
class Damaged:
    """Something committed that cannot be read as its manifest says."""

    unit: str
    """Unit id, or a block's where its manifest is unreadable: either is what `discard_unit` takes."""
    generation: int
    """Generation, or the block's version."""
    message: str
    """What is wrong, with the file."""


def manifest_uri(run: str, unit: str, generation: int = 0) -> str:
    """Return where a unit's manifest lies until it is merged into a block."""
    return numbered_uri(run, UNITS, unit, generation)


def commit_unit(run: str, unit: str, rows: Mapping[str, Sequence[Any]], *, epoch: int = 0) -> Commit:
    """Write a unit's parts, then its manifest where none lies.

    Args:
        run: Run folder.
        unit: Unit id.
        rows: Records by table name; a table may be missing or empty, but one of `MAIN_TABLES` has the unit's items.
        epoch: Which driver writes, for the manifest.

    Raises:
        InputError: The folder may not be written, or the manifest of whoever was first is damaged.
        StopError: The disk takes no more.
    """
    parts = {}
    checked_id(unit)
    for name, records in rows.items():
        if records:
            spec = table_spec(name)
            parts[name] = write_part(run, spec, unit, encode_part(spec, records), len(records))
    items = next(found for name in MAIN_TABLES if (found := rows.get(name)))
    statuses = dict(sorted(Counter(row.status for row in items).items()))
    while True:
        generation = _generation(run, unit)
        manifest = Manifest(unit, len(items), statuses, parts, epoch, generation)
        if storage.create_bytes(manifest_uri(run, unit, generation), encode_manifest(manifest)):
            return Commit(True, manifest)
        if _generation(run, unit) == generation:
            return Commit(False, load_manifest(run, unit))


def write_part(run: str, spec: TableSpec[Any], owner: str, data: bytes, rows: int) -> PartEntry:
    """Write a part under a name of its content: an attempt never overwrites another's with something else.

    Args:
        run: Run folder.
        spec: Its table.
        owner: Unit or block id.
        data: The Parquet file.
        rows: Rows in it.
    """
    sha256 = hashlib.sha256(data).hexdigest()
    path = f"{spec.name}/{owner}-{sha256[:12]}.parquet"
    storage.write_bytes_atomic(storage.join(run, *path.split("/")), data)
    return PartEntry(path, sha256, len(data), rows, spec.version)


def discard_unit(run: str, unit: str, *, epoch: int = 0, reason: str = "", generation: int | None = None) -> bool:
    """Take a committed unit back, so that it is done again; its files stay as evidence.

    Args:
        run: Run folder.
        unit: Unit id, or what `Damaged.unit` says.
        epoch: Which driver asks, for the record.
        reason: Why, for the record.
        generation: The generation that was found wanting: a commit that somebody has made since then stays. None for
            whichever is next.

    Returns:
        True when this call took it back, or the very same one before; False when somebody else had.
    """
    number = _generation(run, unit) if generation is None else generation
    content: dict[str, Any] = {"unit": unit, "generation": number, "epoch": epoch, "reason": reason}
    for folder in (UNITS, BLOCKS):
        uri = numbered_uri(run, folder, unit, number)
        if storage.exists(uri):
            content["manifest"] = storage.read_bytes(uri).decode(errors="replace")
    return storage.create_bytes(numbered_uri(run, DISCARDED, unit, number), sealed(content))


def _generation(run: str, unit: str) -> int:
    """Return the first generation that has not been discarded."""
    generation = 0
    while storage.exists(numbered_uri(run, DISCARDED, unit, generation)):
        generation += 1
    return generation


def load_manifest(run: str, unit: str) -> Manifest:
    """Return a unit's manifest.

    Raises:
        InputError: The unit is not committed, or its manifest is damaged or of an unknown layout.
    """
    uri = manifest_uri(run, unit, _generation(run, unit))
    if storage.exists(uri):
        return decode_manifest(storage.read_bytes(uri), unit, uri)
    return Committed.load(run).manifest(unit)


def committed_units(run: str) -> tuple[str, ...]:
    """Return the ids of all committed units, sorted; their parts are not read.

    Units of a block whose manifest is damaged are not among them, as `resume` has to do them again.
    """
    return Committed.load(run, strict=False).units


def all_manifests(run: str) -> Iterator[Manifest]:
    """Yield the manifests of all committed units, sorted by id: one file is read a block and a unit in none.

    Raises:
        InputError: A manifest is damaged.
    """
    committed = Committed.load(run)
    for unit in committed.units:
        yield committed.manifest(unit)


def read_part(run: str, manifest: Manifest, table: str) -> pa.Table:
    """Return one table's rows of a committed unit, verified against the manifest; no rows where it has none.

    Raises:
        InputError: The part is missing, damaged, or of a version that cannot be read.
    """
    return PartReader(run).read(manifest, table)


def damage(run: str, unit: str) -> str:
    """Return what is wrong with a committed unit, or an empty text when every part is as its manifest says."""
    try:
        manifest, reader = load_manifest(run, unit), PartReader(run)
        for table in manifest.parts:
            reader.read(manifest, table)
    except InputError as error:
        return str(error)
    return ""


def damaged_units(run: str) -> Iterator[Damaged]:
    """Read everything that is committed and yield what is wrong with it; a file is read once."""
    committed, reader = Committed.load(run, strict=False), PartReader(run)
    for block, version, error in committed.unreadable:
        yield Damaged(block, version, str(error))
    for unit in committed.in_order_of_files():
        try:
            manifest = committed.manifest(unit)
            for table in manifest.parts:
                reader.read(manifest, table)
        except InputError as error:
            yield Damaged(unit, committed.generation(unit), str(error))
