"""The commit: parts first, then the unit's manifest, and the manifest is the commit.

Parts are named by their content, so an interrupted or repeated attempt never overwrites a part that a manifest names.
A reader starts from manifests and hence never sees half a unit; a part without a manifest does not count.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from schemas import storage
from schemas.errors import InputError
from schemas.parts import decode_part, encode_part
from schemas.tables import TABLES, table_spec

if TYPE_CHECKING:
    import pyarrow as pa

FOLDER = "manifests"
FORMAT = 1
"""Version of the manifest's own layout."""


@dataclass(frozen=True, slots=True)
class PartEntry:
    """One part as its manifest names it."""

    path: str
    """Path below the run folder."""
    sha256: str
    """Hash of its bytes."""
    bytes: int
    """Size."""
    rows: int
    """Rows, at least 1: a table without rows has no part."""
    version: int
    """Table version."""


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
    format: int = FORMAT
    """Layout version."""


def manifest_uri(run: str, unit: str) -> str:
    """Return where a unit's manifest lies."""
    return storage.join(run, FOLDER, f"{unit}.json")


def commit_unit(run: str, unit: str, rows: Mapping[str, Sequence[Any]]) -> Manifest:
    """Write a unit's parts, then its manifest; return the manifest.

    Args:
        run: Run folder.
        unit: Unit id.
        rows: Records by table name; a table may be missing or empty, `answers` may not.
    """
    parts = {}
    for name, records in rows.items():
        if not records:
            continue
        spec = table_spec(name)
        data = encode_part(spec, records)
        sha256 = hashlib.sha256(data).hexdigest()
        path = f"{name}/{unit}-{sha256[:12]}.parquet"
        storage.write_bytes_atomic(storage.join(run, *path.split("/")), data)
        parts[name] = PartEntry(path, sha256, len(data), len(records), spec.version)
    answers = rows["answers"]
    manifest = Manifest(unit, len(answers), dict(sorted(Counter(row.status for row in answers).items())), parts)
    text = json.dumps(dataclasses.asdict(manifest), indent=1, sort_keys=True)
    storage.write_bytes_atomic(manifest_uri(run, unit), text.encode())
    return manifest


def load_manifest(run: str, unit: str) -> Manifest:
    """Return a unit's manifest.

    Raises:
        InputError: It is not one, or names a table or layout that this version does not know.
    """
    uri = manifest_uri(run, unit)
    try:
        found = json.loads(storage.read_bytes(uri))
        parts = {name: PartEntry(**entry) for name, entry in found.pop("parts").items()}
        manifest = Manifest(parts=parts, **found)
    except (json.JSONDecodeError, UnicodeDecodeError, TypeError, KeyError, AttributeError) as error:
        raise InputError(uri, expected="a manifest", found=f"{type(error).__name__}: {error}") from error
    if manifest.unit != unit or manifest.format != FORMAT or not set(parts) <= set(TABLES):
        expected = f"unit {unit}, format {FORMAT}, tables among {', '.join(TABLES)}"
        raise InputError(uri, expected=expected, found=f"unit {manifest.unit}, format {manifest.format}, {list(parts)}")
    return manifest


def committed_units(run: str) -> tuple[str, ...]:
    """Return the ids of all units with a manifest, sorted; their parts are not read."""
    names = (uri.rsplit("/", 1)[-1] for uri in storage.list_files(storage.join(run, FOLDER)))
    return tuple(sorted(name.removesuffix(".json") for name in names if name.endswith(".json")))


def read_part(run: str, manifest: Manifest, table: str) -> pa.Table:
    """Return one table's rows of a committed unit, verified against the manifest; no rows where it has none.

    Raises:
        InputError: The part is missing, damaged, or of another version.
    """
    spec = table_spec(table)
    if table not in manifest.parts:
        return spec.arrow_schema().empty_table()
    entry = manifest.parts[table]
    uri = storage.join(run, *entry.path.split("/"))
    found = decode_part(spec, storage.read_bytes(uri), uri, entry.sha256)
    if found.num_rows != entry.rows:
        raise InputError(uri, field="rows", expected=f"{entry.rows}, as its manifest says", found=found.num_rows)
    return found


def damage(run: str, unit: str) -> str:
    """Return what is wrong with a committed unit, or an empty text when every part is as its manifest says."""
    try:
        manifest = load_manifest(run, unit)
        for table in manifest.parts:
            read_part(run, manifest, table)
    except (InputError, OSError) as error:
        return str(error)
    return ""
