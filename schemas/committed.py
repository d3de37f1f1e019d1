"""What a run has committed, as one look at its folder finds it, and how its parts are read.

Of several manifests of one unit the lowest generation that was not discarded counts, and of two of the same generation
the one in a block: it was merged from the first commit before that one was removed. Folders are looked through in an
order in which nothing can slip by while a driver commits, discards and merges (docs/decisions/0007-commit.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from schemas import storage
from schemas.errors import InputError
from schemas.manifest_file import (
    BLOCKS,
    DISCARDED,
    UNITS,
    Manifest,
    decode_block,
    decode_manifest,
    numbered_names,
    numbered_uri,
)
from schemas.parts import decode_part
from schemas.tables import table_spec

if TYPE_CHECKING:
    import pyarrow as pa

LOOKS = 20
"""Looks before a folder that changes under each of them is given up on."""


@dataclass(slots=True)
class Committed:
    """The committed units of a run at one moment."""

    run: str
    """Run folder."""
    blocks: Mapping[str, tuple[int, int]]
    """The version of each block that counts, which is the last that was not discarded or -1, and the last."""
    merged: Mapping[str, Manifest]
    """Manifests of units in blocks."""
    loose: Mapping[str, int]
    """Units with a manifest of their own that counts, and its generation."""
    shadowed: Mapping[str, tuple[int, ...]]
    """Generations of merged units whose own manifests lie there still, and do not count."""
    unreadable: tuple[tuple[str, int, InputError], ...]
    """Blocks whose manifest is damaged: id, version, why."""
    _only: str | None = None
    """The one block that was looked at; None for all."""
    _kept: dict[str, Manifest] = field(default_factory=dict)
    """Manifests of loose units that have been read."""

    @staticmethod
    def load(run: str, *, strict: bool = True, only: str | None = None) -> Committed:
        """Return what a run has committed.

        Args:
            run: Run folder.
            strict: Whether a damaged manifest of a block is an error.
            only: The one block to look at; units of others are not found. None for all.

        Raises:
            InputError: A block's manifest is damaged; the message says in which file.
        """
        gone = {name: set(numbers) for name, numbers in numbered_names(run, DISCARDED).items()}
        manifests = numbered_names(run, UNITS)
        blocks, found, unreadable = _blocks(run, gone, only)
        if strict and unreadable:
            raise unreadable[0][2]
        merged = {m.unit: m for m in found if m.generation not in gone.get(m.unit, ())}
        loose, shadowed = dict[str, int](), dict[str, tuple[int, ...]]()
        for unit, numbers in manifests.items():
            counting = next((number for number in numbers if number not in gone.get(unit, ())), None)
            if unit in merged and (counting is None or merged[unit].generation <= counting):
                shadowed[unit] = tuple(numbers)
            elif counting is not None:
                merged.pop(unit, None)
                loose[unit] = counting
        return Committed(run, blocks, merged, loose, shadowed, unreadable, only)

    @property
    def units(self) -> tuple[str, ...]:
        """Ids of the committed units, sorted."""
        return tuple(sorted([*self.merged, *self.loose]))

    def __contains__(self, unit: str) -> bool:
        return unit in self.merged or unit in self.loose

    def generation(self, unit: str) -> int:
        """Return the generation of a committed unit that counts."""
        return self.merged[unit].generation if unit in self.merged else self.loose[unit]

    def in_order_of_files(self) -> list[str]:
        """Return the units so that those which share files follow each other."""
        return [*self.merged, *sorted(self.loose)]

    def manifest(self, unit: str) -> Manifest:
        """Return a unit's manifest, also when it was merged into a block after this look.

        Raises:
            InputError: The unit is not committed, or its manifest is damaged.
        """
        if unit in self.merged:
            return self.merged[unit]
        if unit in self._kept:
            return self._kept[unit]
        if unit not in self.loose:
            raise InputError(self.run, field=f"unit {unit}", expected="a committed unit", found="none")
        uri = numbered_uri(self.run, UNITS, unit, self.loose[unit])
        try:
            self._kept[unit] = decode_manifest(storage.read_bytes(uri), unit, uri)
        except InputError:
            if storage.exists(uri):
                raise
            self.look_again()
        return self.manifest(unit)

    def look_again(self) -> None:
        """Take another look at the folder."""
        now = Committed.load(self.run, only=self._only)
        self.blocks, self.merged, self.loose, self.shadowed = now.blocks, now.merged, now.loose, now.shadowed
        self._kept = {}

    def read(self, reader: PartReader, unit: str, table: str, columns: tuple[str, ...] | None = None) -> pa.Table:
        """Return one table's rows of a unit, also when its files were merged after this look.

        Raises:
            InputError: The unit is not committed, or a file is missing or damaged.
        """
        for _ in range(LOOKS):
            manifest = self.manifest(unit)
            try:
                return reader.read(manifest, table, columns)
            except InputError:
                self.look_again()
                if unit not in self or self.manifest(unit).parts == manifest.parts:
                    raise
        raise InputError(self.run, field=f"unit {unit}", expected="parts that stay", found="files that change")


def _blocks(
    run: str, gone: Mapping[str, set[int]], only: str | None
) -> tuple[dict[str, tuple[int, int]], list[Manifest], tuple[tuple[str, int, InputError], ...]]:
    """Return the versions of each block, the units of those that count, and what could not be read."""
    for _ in range(LOOKS):
        names = numbered_names(run, BLOCKS)
        # Two looks that agree: a folder is not listed at one moment, and a block may be replaced meanwhile.
        if names != numbered_names(run, BLOCKS):
            continue
        versions, units, unreadable, vanished = dict[str, tuple[int, int]](), list[Manifest](), [], False
        for block, numbers in sorted(names.items()):
            left = [number for number in numbers if number not in gone.get(block, ())]
            versions[block] = (left[-1] if left else -1, numbers[-1])
            if not left or only not in (None, block):
                continue
            uri = numbered_uri(run, BLOCKS, block, left[-1])
            try:
                units += decode_block(storage.read_bytes(uri), block, uri)
            except InputError as error:
                vanished |= not storage.exists(uri)
                unreadable.append((block, left[-1], error))
        if not vanished:
            return versions, units, tuple(unreadable)
    raise InputError(storage.join(run, BLOCKS), expected="a folder that can be listed", found="one that changes")


class PartReader:
    """Reads parts, and keeps the latest file of each table and choice of columns: units of a block share one.

    Args:
        run: Run folder.
    """

    def __init__(self, run: str) -> None:
        self._run = run
        self._latest: dict[tuple[str, tuple[str, ...] | None], tuple[str, pa.Table | InputError]] = {}

    def read(self, manifest: Manifest, table: str, columns: tuple[str, ...] | None = None) -> pa.Table:
        """Return one table's rows of a unit, verified, with all columns or some; see `manifest.read_part`."""
        spec = table_spec(table)
        if table not in manifest.parts:
            return spec.conform(spec.arrow_schema().empty_table(), columns)
        entry = manifest.parts[table]
        uri = storage.join(self._run, *entry.path.split("/"))
        whole = self._file(table, uri, entry.sha256, columns)
        expected = entry.rows if entry.file_rows is None else entry.file_rows
        if whole.num_rows != expected:
            raise InputError(uri, field="rows", expected=f"{expected}, as its manifest says", found=whole.num_rows)
        return whole.slice(entry.first, entry.rows)

    def _file(self, table: str, uri: str, sha256: str, columns: tuple[str, ...] | None) -> pa.Table:
        key = table, columns
        if self._latest.get(key, ("",))[0] != uri:
            try:
                data = storage.read_bytes(uri)
                found: pa.Table | InputError = decode_part(table_spec(table), data, uri, sha256, columns)
            except InputError as error:
                found = error
            self._latest[key] = (uri, found)
        latest = self._latest[key][1]
        if isinstance(latest, InputError):
            raise latest
        return latest
