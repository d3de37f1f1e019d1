"""Compaction: the parts of many committed units merged into one part a table, so that a run has few files.

Consecutive units of the plan form a block. When all of a block is committed its rows are written once more, together,
then its manifest, where none lies, and only then are the small files removed. A reader that still holds one of those
looks again (`Committed.read`). A block is one function of the plan, so two drivers cannot merge a unit into two.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Sequence

from schemas import storage
from schemas.committed import Committed, PartReader
from schemas.errors import InputError
from schemas.manifest import write_part
from schemas.manifest_file import (
    BLOCKS,
    UNITS,
    Manifest,
    decode_block,
    decode_manifest,
    encode_block,
    numbered_names,
    numbered_uri,
)
from schemas.parts import encode_table
from schemas.tables import ALL_TABLES

BLOCK_QUESTIONS = 6_400
"""Questions a block: 256 units of 25, so a million questions are 157 blocks; of the order of 100 MB while merging."""


def blocks_of(sizes: Iterable[tuple[str, int]]) -> Iterator[tuple[str, ...]]:
    """Yield the units of each full block; what is left over at the plan's end stays as it is.

    Args:
        sizes: Unit id and number of questions, in plan order.
    """
    units, questions = list[str](), 0
    for unit, size in sizes:
        units.append(unit)
        questions += size
        if questions >= BLOCK_QUESTIONS:
            yield tuple(units)
            units, questions = [], 0


class Compactor:
    """Merges the blocks of a run as they become complete; what a crash left unmerged is merged on making it.

    Args:
        run: Run folder.
        sizes: Unit id and number of questions, in plan order.
        epoch: Which driver merges, for the record.

    Raises:
        InputError: A part of a complete block is damaged.
    """

    def __init__(self, run: str, sizes: Iterable[tuple[str, int]], *, epoch: int = 0) -> None:
        self._run, self._epoch = run, epoch
        self._blocks = list(blocks_of(sizes))
        self._block_of = {unit: place for place, units in enumerate(self._blocks) for unit in units}
        committed = Committed.load(run) if self._blocks else None
        self._missing = [{unit for unit in units if unit not in (committed or ())} for units in self._blocks]
        if committed is not None:
            for place, units in enumerate(self._blocks):
                left_over = not self._missing[place] and any(unit in committed.loose for unit in units)
                if left_over or any(unit in committed.shadowed for unit in units):
                    self._merge(units)

    def committed(self, unit: str) -> bool:
        """Merge the unit's block if this was its last; return whether it was.

        Raises:
            InputError: A part of the block is damaged: nothing is merged, and `resume` does that unit again.
            StopError: The disk takes no more.
        """
        place = self._block_of.get(unit)
        if place is None or unit not in self._missing[place]:
            return False
        self._missing[place].discard(unit)
        if self._missing[place]:
            return False
        self._merge(self._blocks[place])
        return True

    def _merge(self, units: Sequence[str]) -> None:
        compact(self._run, units, epoch=self._epoch)


def block_id(units: Sequence[str]) -> str:
    """Return the id of a block of units: a hash of theirs."""
    return hashlib.sha256("\n".join(units).encode()).hexdigest()[:32]


def compact(run: str, units: Sequence[str], *, epoch: int = 0) -> None:
    """Merge the committed units of a block, and remove the files that are not needed any more.

    Args:
        run: Run folder.
        units: The units, in plan order, all committed.
        epoch: Which driver merges, for the record.

    Raises:
        InputError: A unit is not committed, or a part is damaged; nothing has been merged.
    """
    block = block_id(units)
    committed = Committed.load(run, only=block)
    if any(unit in committed.loose for unit in units):
        version = committed.blocks.get(block, (-1, -1))[1] + 1
        try:
            _write_block(run, block, version, [committed.manifest(unit) for unit in units], epoch)
        except InputError:
            # Another driver may have merged this block, and removed what was being read.
            if not storage.exists(numbered_uri(run, BLOCKS, block, version)):
                raise
        committed = Committed.load(run, only=block)
    _clear(run, committed, block, units)


def _write_block(run: str, block: str, version: int, manifests: Sequence[Manifest], epoch: int) -> None:
    """Write one part a table and the block's manifest; if another driver was first, its block counts."""
    import pyarrow as pa

    reader, parts = PartReader(run), {}
    for name, spec in ALL_TABLES.items():
        tables = [reader.read(manifest, name) for manifest in manifests if name in manifest.parts]
        if tables:
            merged = pa.concat_tables(tables).combine_chunks()
            parts[name] = write_part(run, spec, block, encode_table(merged), merged.num_rows)
    storage.create_bytes(
        numbered_uri(run, BLOCKS, block, version), encode_block(block, version, epoch, parts, manifests)
    )


def _clear(run: str, committed: Committed, block: str, units: Sequence[str]) -> None:
    """Remove manifests and parts of the block's units that were merged, and earlier versions of the block."""
    needed = {entry.path for unit in units for entry in committed.manifest(unit).parts.values()}
    for unit in units:
        for number in committed.shadowed.get(unit, ()):
            _remove_with_parts(run, UNITS, unit, number, needed)
    for number in numbered_names(run, BLOCKS).get(block, ()):
        if number < committed.blocks[block][0]:
            _remove_with_parts(run, BLOCKS, block, number, needed)


def _remove_with_parts(run: str, folder: str, name: str, number: int, needed: Collection[str]) -> None:
    """Remove a manifest, then its parts that are not needed; those of a damaged one stay, as nothing names them."""
    uri = numbered_uri(run, folder, name, number)
    try:
        data = storage.read_bytes(uri)
        found = decode_block(data, name, uri) if folder == BLOCKS else (decode_manifest(data, name, uri),)
    except InputError:
        found = ()
    storage.remove(uri)
    for path in {entry.path for manifest in found for entry in manifest.parts.values()}.difference(needed):
        storage.remove(storage.join(run, *path.split("/")))
