"""Table `semantics`: one row a Gaussian of a scene, in the order of its splat file. Written once, read by every job.

The vocabulary lies in the file's metadata beside the version. Pages carry checksums, verified on read: without them
most single-bit flips in a Parquet file come back as silently wrong values.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schemas.errors import InputError
from schemas.storage import local_copy, read_bytes, write_bytes_atomic

if TYPE_CHECKING:
    import pyarrow as pa

NAME = "semantics"
VERSION = 1
METADATA_KEY = b"splatreasoner"
CATEGORY, EMBEDDING, INSTANCE = "category_id", "embedding", "instance_id"
"""Its columns."""


@dataclass(frozen=True, slots=True)
class SemanticsTable:
    """The columns of semantics.parquet; a column that is None is absent from the file."""

    vocabulary: tuple[str, ...]
    """Category names; `category` indexes it."""
    category: np.ndarray | None = None
    """Category id per Gaussian, (M,) int32, -1 unlabelled."""
    embedding: np.ndarray | None = None
    """Open-set feature per Gaussian, (M, D) float16 or float32."""
    instance: np.ndarray | None = None
    """Ground-truth instance id per Gaussian, (M,) int32, -1 none."""


def write_semantics(table: SemanticsTable, uri: str | os.PathLike[str]) -> None:
    """Write semantics.parquet atomically.

    Raises:
        InputError: No column is given, lengths or types are not as declared, or the place may not be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays: dict[str, pa.Array] = {}
    for name, values in ((CATEGORY, table.category), (INSTANCE, table.instance)):
        if values is not None:
            if values.ndim != 1 or values.dtype != np.int32:
                raise InputError(uri, field=name, expected="int32 of one dimension", found=_described(values))
            arrays[name] = pa.array(values, pa.int32())
    if (embedding := table.embedding) is not None:
        if embedding.ndim != 2 or embedding.shape[1] < 1 or embedding.dtype not in (np.float16, np.float32):
            raise InputError(uri, field="embedding", expected="(M, D) float16 or float32", found=_described(embedding))
        flat = pa.array(np.ascontiguousarray(embedding).reshape(-1))
        arrays[EMBEDDING] = pa.FixedSizeListArray.from_arrays(flat, embedding.shape[1])
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) != 1:
        raise InputError(uri, expected="at least one column, all of one length", found=lengths or "no column")
    fields = [pa.field(name, array.type, nullable=False) for name, array in arrays.items()]
    schema = pa.schema(fields, metadata={METADATA_KEY: json.dumps(_metadata(table.vocabulary)).encode()})
    sink = pa.BufferOutputStream()
    pq.write_table(
        pa.Table.from_arrays(list(arrays.values()), schema=schema),
        sink,
        compression="zstd",
        use_dictionary=[CATEGORY, INSTANCE],
        write_page_checksum=True,
    )
    write_bytes_atomic(uri, sink.getvalue().to_pybytes())


def read_semantics(uri: str | os.PathLike[str]) -> SemanticsTable:
    """Return the columns of a semantics.parquet, pages verified.

    Raises:
        InputError: The file is missing, damaged, of another version, or a column or the vocabulary is not as declared.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    data = read_bytes(uri)
    try:
        table = pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True).read()
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        raise InputError(uri, expected="an undamaged Parquet file", found=_first_line(error)) from error
    vocabulary = _vocabulary(uri, (table.schema.metadata or {}).get(METADATA_KEY))
    unknown = set(table.column_names) - {CATEGORY, EMBEDDING, INSTANCE}
    if unknown or not table.num_columns:
        expected = f"{CATEGORY}, {EMBEDDING} or {INSTANCE}"
        raise InputError(uri, field="columns", expected=expected, found=sorted(unknown) or "none")
    return SemanticsTable(vocabulary, _ids(uri, table, CATEGORY), _embedding(uri, table), _ids(uri, table, INSTANCE))


def read_semantics_columns(uri: str | os.PathLike[str]) -> dict[str, int]:
    """Return the columns of a semantics.parquet and how many numbers each has a Gaussian, from the footer alone.

    Raises:
        InputError: The file is missing or damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    with local_copy(uri) as path:
        try:
            schema = pq.read_schema(path)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise InputError(uri, expected="an undamaged Parquet file", found=_first_line(error)) from error
    sizes = {field.name: field.type for field in schema}
    return {name: kind.list_size if pa.types.is_fixed_size_list(kind) else 1 for name, kind in sizes.items()}


def _metadata(vocabulary: tuple[str, ...]) -> dict[str, Any]:
    # The footer is the one part of a Parquet file without a checksum, and the vocabulary lies in it.
    digest = hashlib.sha256("\n".join(vocabulary).encode()).hexdigest()
    return {"table": NAME, "version": VERSION, "vocabulary": list(vocabulary), "vocabulary_sha256": digest}


def _vocabulary(uri: str | os.PathLike[str], raw: bytes | None) -> tuple[str, ...]:
    expected = f'metadata "{METADATA_KEY.decode()}" with table {NAME!r}, version {VERSION} and a vocabulary'
    if raw is None:
        raise InputError(uri, field="metadata", expected=expected, found="none")
    try:
        stored = json.loads(raw)
    except ValueError as error:
        raise InputError(uri, field="metadata", expected=expected, found=f"no JSON ({error})") from error
    if not isinstance(stored, dict) or stored.get("table") != NAME or stored.get("version") != VERSION:
        found = {key: stored.get(key) for key in ("table", "version")} if isinstance(stored, dict) else stored
        raise InputError(uri, field="metadata", expected=expected, found=found)
    names = stored.get("vocabulary")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(uri, field="vocabulary", expected="a list of names", found=names)
    vocabulary = tuple(names)
    digest = _metadata(vocabulary)["vocabulary_sha256"]
    if stored.get("vocabulary_sha256", digest) != digest:
        raise InputError(uri, field="vocabulary", expected="names that match their checksum", found="a damaged list")
    return vocabulary


def _ids(uri: str | os.PathLike[str], table: pa.Table, name: str) -> np.ndarray | None:
    import pyarrow as pa

    if name not in table.column_names:
        return None
    column = table.column(name)
    if column.type != pa.int32() or column.null_count:
        raise InputError(uri, field=name, expected="int32 without nulls", found=_column(column))
    return np.ascontiguousarray(column.to_numpy())


def _embedding(uri: str | os.PathLike[str], table: pa.Table) -> np.ndarray | None:
    import pyarrow as pa

    if EMBEDDING not in table.column_names:
        return None
    column = table.column(EMBEDDING)
    kind = column.type
    if not (pa.types.is_fixed_size_list(kind) and kind.value_type in (pa.float16(), pa.float32())) or column.null_count:
        expected = "fixed-size lists of float16 or float32 without nulls"
        raise InputError(uri, field="embedding", expected=expected, found=_column(column))
    flat = column.combine_chunks().flatten()
    if flat.null_count:
        raise InputError(uri, field="embedding", expected="lists without nulls", found=f"{flat.null_count} nulls")
    return np.ascontiguousarray(flat.to_numpy(zero_copy_only=False)).reshape(-1, kind.list_size)


def _column(column: pa.ChunkedArray) -> str:
    return f"{column.type}, {column.null_count} nulls"


def _described(array: np.ndarray) -> str:
    return f"{array.dtype} of shape {array.shape}"


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
