"""Table `visibility`: one row a rendered view, with the sorted ids of the Gaussians that dominate a pixel of it.

Parts are Arrow IPC files without compression, so a local one is mapped and its ids are used where they lie. A part's
name is the hash of its bytes: any number of writers may commit side by side, a name that exists need not be written
again, and a reader knows a damaged part by its name. Parts of one space (scene and render settings) share a folder,
`<root>/<space>/<hash>.arrow`; rows are found by view, so it does not matter who wrote which views together.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schemas import storage
from schemas.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

NAME = "visibility"
VERSION = 1
METADATA_KEY = b"splatreasoner"
KEY_BYTES = 32
_PART = re.compile(r"[0-9a-f]{64}\.arrow")
"""Anything else in the folder, such as what a killed writer left, is no part."""


@dataclass(frozen=True, slots=True)
class VisibilitySpace:
    """Where rows may be shared: the same Gaussians rendered with the same settings."""

    key: str
    """Hash of both, hexadecimal."""
    gaussians: int
    """M; ids are 0 to M - 1."""

    def folder(self, root: str) -> str:
        """Return the folder of its parts."""
        return storage.join(root, self.key)

    def metadata(self) -> dict[str, Any]:
        """Return what every part says of itself."""
        return {"table": NAME, "version": VERSION, "space": self.key, "gaussians": self.gaussians}


@dataclass(frozen=True, slots=True)
class StoredRows:
    """What a space's parts hold."""

    ids: Mapping[str, np.ndarray]
    """Sorted ids, int32 and read-only, by view key; in the mapped file where that is local."""
    damaged: Mapping[str, str]
    """What is wrong, by URI, with each part that was passed over."""


def write_rows(root: str, space: VisibilitySpace, rows: Mapping[str, np.ndarray]) -> str:
    """Commit rows as one part, put if absent; return its URI.

    Args:
        root: Folder of the store, a path or URI.
        space: What was rendered.
        rows: Sorted ids, int32, by view key; at least one.

    Raises:
        InputError: The place may not be written.
        RetryError: A remote store failed to answer.
    """
    assert rows, "a part has at least one row"
    data = _encoded(space, rows)
    uri = storage.join(space.folder(root), f"{hashlib.sha256(data).hexdigest()}.arrow")
    if not storage.exists(uri):
        storage.write_bytes_atomic(uri, data)
    return uri


def read_rows(root: str, space: VisibilitySpace) -> StoredRows:
    """Return the rows of every sound part of a space; none where nothing was stored.

    Raises:
        InputError: The folder may not be read.
        RetryError: A remote store failed to answer.
    """
    found: dict[str, np.ndarray] = {}
    damaged: dict[str, str] = {}
    folder = space.folder(root)
    for name in storage.list_files(folder):
        if not _PART.fullmatch(name):
            continue
        uri = storage.join(folder, name)
        try:
            rows = _decoded(space, _content(uri), uri, name.removesuffix(".arrow"))
        except InputError as error:
            if storage.exists(uri):  # else another reader has removed a damaged part meanwhile
                damaged[uri] = str(error)
            continue
        for key, ids in rows.items():
            found.setdefault(key, ids)
    return StoredRows(found, damaged)


def _schema(space: VisibilitySpace) -> pa.Schema:
    import pyarrow as pa

    ids = pa.large_list(pa.field("item", pa.int32(), nullable=False))
    fields = [pa.field("view", pa.binary(KEY_BYTES), nullable=False), pa.field("ids", ids, nullable=False)]
    return pa.schema(fields, metadata={METADATA_KEY: json.dumps(space.metadata(), sort_keys=True).encode()})


def _encoded(space: VisibilitySpace, rows: Mapping[str, np.ndarray]) -> bytes:
    import pyarrow as pa

    keys = sorted(rows)  # the same rows give the same bytes, whatever order they were rendered in
    starts = np.concatenate([[0], np.cumsum([len(rows[key]) for key in keys], dtype=np.int64)])
    ids = np.concatenate([rows[key] for key in keys])
    assert ids.dtype == np.int32, ids.dtype
    schema = _schema(space)
    columns = [
        pa.array([bytes.fromhex(key) for key in keys], schema.field("view").type),
        pa.LargeListArray.from_arrays(pa.array(starts), pa.array(ids), type=schema.field("ids").type),
    ]
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, schema) as writer:
        writer.write_batch(pa.record_batch(columns, schema=schema))
    return bytes(sink.getvalue().to_pybytes())


def _content(uri: str) -> pa.Buffer:
    """Return the bytes of a part, mapped where it is local."""
    import pyarrow as pa

    path = storage.local_path(uri)
    if path is None:
        return pa.py_buffer(storage.read_bytes(uri))
    try:
        return pa.memory_map(str(path)).read_buffer()
    except OSError as error:  # an empty file cannot be mapped
        raise InputError(uri, expected="a file that can be mapped", found=error) from error


def _decoded(space: VisibilitySpace, content: pa.Buffer, uri: str, sha256: str) -> dict[str, np.ndarray]:
    """Return a part's rows, views into `content`, after checking them."""
    import pyarrow as pa

    if (found := hashlib.sha256(content).hexdigest()) != sha256:
        raise InputError(uri, field="sha256", expected="the hash it is named by", found=found)
    try:
        table = pa.ipc.open_file(content).read_all()
    except (pa.ArrowException, OSError) as error:
        raise InputError(uri, expected="an Arrow file", found=str(error).splitlines()[0]) from error
    schema = _schema(space)
    if not table.schema.equals(schema, check_metadata=True):
        raise InputError(uri, field="schema", expected=_described(schema), found=_described(table.schema))
    rows: dict[str, np.ndarray] = {}
    for batch in table.to_batches():
        lists = batch.column("ids")
        starts, ids = lists.offsets.to_numpy(), lists.values.to_numpy(zero_copy_only=True)
        if len(ids) and not (ids.min() >= 0 and ids.max() < space.gaussians):
            raise InputError(uri, field="ids", expected=f"0 to {space.gaussians - 1}", found=(ids.min(), ids.max()))
        for key, start, end in zip(batch.column("view").to_pylist(), starts[:-1], starts[1:], strict=True):
            rows[key.hex()] = ids[start:end]
    return rows


def _described(schema: pa.Schema) -> str:
    metadata = (schema.metadata or {}).get(METADATA_KEY, b"no metadata").decode(errors="replace")
    return f"{', '.join(f'{field.name} {field.type}' for field in schema)}; {metadata}"
