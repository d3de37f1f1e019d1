"""Parts: how rows become Parquet bytes and back.

Writer settings are fixed, so the same rows give the same bytes, and pages carry checksums: without them a flipped bit
in a Parquet file mostly comes back as a wrong value, not as an error. Where parts lie, and when they count, is the
manifest's business (`manifest.py`).
"""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from schemas.errors import InputError
from schemas.table import TableSpec

if TYPE_CHECKING:
    import pyarrow as pa

R = TypeVar("R")

ROW_GROUP_ROWS = 65_536
"""Rows a row group; fixed, since it changes the bytes, and small enough to bound a reader's memory."""

THREADS_FROM_BYTES = 4 << 20
"""Smaller files are read faster by one thread than several are woken."""

WRITER: dict[str, Any] = {
    "version": "2.6",
    "compression": "zstd",
    "compression_level": 3,
    "use_dictionary": True,
    "write_statistics": True,
    "data_page_version": "1.0",
    "store_schema": True,
    "write_page_checksum": True,
}
"""Every setting that changes the bytes is named, so that a new pyarrow default does not."""


def encode_part(spec: TableSpec[R], rows: Iterable[R]) -> bytes:
    """Return the rows as the bytes of one Parquet file."""
    return encode_table(spec.to_arrow(rows))


def encode_table(table: pa.Table) -> bytes:
    """Return an Arrow table, with the schema of its spec, as the bytes of one Parquet file."""
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    pq.write_table(table, sink, row_group_size=ROW_GROUP_ROWS, **WRITER)
    return sink.getvalue()


def decode_part(
    spec: TableSpec[Any],
    data: bytes,
    subject: object,
    sha256: str | None = None,
    columns: Sequence[str] | None = None,
) -> pa.Table:
    """Return the table in a part's bytes, after checking them.

    Args:
        spec: The table it must be.
        data: The bytes of the file.
        subject: Where they came from, for messages.
        sha256: What they must hash to; None when no manifest says.
        columns: Columns wanted; None for all.

    Raises:
        InputError: The hash, a page checksum, the table's name, its version or a column is wrong.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if sha256 is not None and (found := hashlib.sha256(data).hexdigest()) != sha256:
        raise InputError(subject, field="sha256", expected=f"{sha256}, as its manifest says", found=found)
    try:
        with pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True) as file:
            spec.check(file.schema_arrow, subject)
            there = None if columns is None else [name for name in columns if name in file.schema_arrow.names]
            table = file.read(there, use_threads=len(data) > THREADS_FROM_BYTES)
        return spec.conform(table, columns)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise InputError(subject, expected="a readable Parquet file", found=str(error).splitlines()[0]) from error


def write_stream(spec: TableSpec[Any], tables: Iterable[pa.Table], path: Path) -> int:
    """Write tables one after the other into one Parquet file, committed when complete; return its rows.

    Row groups are cut anew, so the bytes do not depend on how the rows were split into parts, and memory stays at
    one row group.
    """
    import pyarrow.parquet as pq

    written = 0
    with _aside(path) as aside, pq.ParquetWriter(aside, spec.arrow_schema(), **WRITER) as writer:
        for group in _regrouped(tables, spec.arrow_schema()):
            writer.write_table(group, row_group_size=ROW_GROUP_ROWS)
            written += group.num_rows
    return written


def _regrouped(tables: Iterable[pa.Table], schema: pa.Schema) -> Iterator[pa.Table]:
    """Yield the rows again in tables of exactly ROW_GROUP_ROWS, the last one smaller."""
    import pyarrow as pa

    waiting = schema.empty_table()
    for table in tables:
        waiting = pa.concat_tables([waiting, table.replace_schema_metadata(schema.metadata)])
        while waiting.num_rows >= ROW_GROUP_ROWS:
            yield waiting.slice(0, ROW_GROUP_ROWS).combine_chunks()
            waiting = waiting.slice(ROW_GROUP_ROWS)
    if waiting.num_rows:
        yield waiting.combine_chunks()


@contextmanager
def _aside(path: Path) -> Iterator[Path]:
    """Give a file beside `path` that takes its place, durably, when the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    os.close(handle)
    aside = Path(name)
    try:
        yield aside
        _fsync(aside)
        aside.replace(path)
        _fsync(path.parent)
    finally:
        aside.unlink(missing_ok=True)


def _fsync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
