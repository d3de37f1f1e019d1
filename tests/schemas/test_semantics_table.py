"""semantics.parquet: what is written is read, and what is damaged or undeclared is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.errors import InputError
from schemas.semantics_table import METADATA_KEY, SemanticsTable, read_semantics, write_semantics

CATEGORY = np.array([0, 1, -1, 1], np.int32)
NAMES = ("chair", "table")


def embedding(dtype: type = np.float32) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(4, 5)).astype(dtype)


def written(folder: Path, **columns: np.ndarray) -> Path:
    path = folder / "semantics.parquet"
    write_semantics(SemanticsTable(NAMES, **columns), path)
    return path


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_every_column_reads_back_bit_for_bit(tmp_path: Path, dtype: type) -> None:
    made = embedding(dtype)
    made[0, 0] = np.nan
    table = read_semantics(written(tmp_path, category=CATEGORY, embedding=made, instance=CATEGORY + 7))
    assert table.vocabulary == NAMES
    assert table.embedding is not None
    assert table.embedding.dtype == dtype
    assert table.embedding.tobytes() == made.tobytes()
    np.testing.assert_array_equal(table.category, CATEGORY)
    np.testing.assert_array_equal(table.instance, CATEGORY + 7)


@pytest.mark.parametrize("name", ["category", "embedding", "instance"])
def test_one_column_alone_reads_and_the_others_are_none(tmp_path: Path, name: str) -> None:
    column = embedding() if name == "embedding" else CATEGORY
    table = read_semantics(written(tmp_path, **{name: column}))
    assert [n for n in ("category", "embedding", "instance") if getattr(table, n) is not None] == [name]


def test_many_row_groups_read_in_order(tmp_path: Path) -> None:
    ids = np.arange(1_100_000, dtype=np.int32)
    path = tmp_path / "s.parquet"
    write_semantics(SemanticsTable((), instance=ids), path)
    assert pq.ParquetFile(path).num_row_groups > 1
    np.testing.assert_array_equal(read_semantics(path).instance, ids)


def test_unicode_names_read_back(tmp_path: Path) -> None:
    names = ("café table", "椅子", 'a "quoted"\nname')
    write_semantics(SemanticsTable(names, category=CATEGORY), tmp_path / "s.parquet")
    assert read_semantics(tmp_path / "s.parquet").vocabulary == names


@pytest.mark.parametrize(
    "columns",
    [
        {},
        {"category": CATEGORY, "instance": CATEGORY[:2]},
        {"category": CATEGORY.astype(np.int64)},
        {"embedding": embedding().astype(np.float64)},
        {"embedding": np.zeros((4, 0), np.float32)},
        {"embedding": np.zeros(4, np.float32)},
    ],
)
def test_undeclared_columns_are_not_written(tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    with pytest.raises(InputError):
        written(tmp_path, **columns)
    assert not list(tmp_path.iterdir())


def test_no_single_bit_flip_gives_wrong_values(tmp_path: Path) -> None:
    ids = np.random.default_rng(0).integers(0, 1000, 3000).astype(np.int32)
    path = tmp_path / "s.parquet"
    table = SemanticsTable(
        tuple(f"n{i}" for i in range(1000)), category=ids, embedding=np.eye(3000, 3, dtype=np.float32)
    )
    write_semantics(table, path)
    data, rng = path.read_bytes(), np.random.default_rng(1)
    caught = 0
    for _ in range(150):
        damaged = bytearray(data)
        damaged[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            read = read_semantics(path)
        except InputError:
            caught += 1
            continue
        assert read.vocabulary == table.vocabulary
        np.testing.assert_array_equal(read.category, ids)
        np.testing.assert_array_equal(read.embedding, table.embedding)
    assert caught > 75


def test_truncated_file_is_an_input_error(tmp_path: Path) -> None:
    path = written(tmp_path, category=CATEGORY)
    data = path.read_bytes()
    for end in (0, 3, 4, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:end])
        with pytest.raises(InputError, match="undamaged Parquet"):
            read_semantics(path)


def rewritten(path: Path, table: pa.Table, metadata: bytes | None) -> Path:
    pq.write_table(table.replace_schema_metadata({METADATA_KEY: metadata} if metadata is not None else None), path)
    return path


GOOD = b'{"table": "semantics", "version": 1, "vocabulary": ["chair", "table"]}'


@pytest.mark.parametrize(
    ("metadata", "field"),
    [
        (None, "metadata"),
        (b"{", "metadata"),
        (b"[]", "metadata"),
        (b'{"table": "answers", "version": 1, "vocabulary": []}', "metadata"),
        (b'{"table": "semantics", "version": 99, "vocabulary": []}', "metadata"),
        (b'{"table": "semantics", "version": 1}', "vocabulary"),
        (b'{"table": "semantics", "version": 1, "vocabulary": [1]}', "vocabulary"),
        (GOOD.replace(b'"]', b'"], "vocabulary_sha256": "00"'), "vocabulary"),
    ],
)
def test_wrong_metadata_is_named(tmp_path: Path, metadata: bytes | None, field: str) -> None:
    path = rewritten(tmp_path / "s.parquet", pa.table({"category_id": pa.array([0, 1], pa.int32())}), metadata)
    with pytest.raises(InputError) as caught:
        read_semantics(path)
    assert (caught.value.subject, caught.value.field) == (str(path), field)


def test_file_of_another_writer_with_the_metadata_reads(tmp_path: Path) -> None:
    table = pa.table({"category_id": pa.array([0, 1], pa.int32())})
    assert read_semantics(rewritten(tmp_path / "s.parquet", table, GOOD)).vocabulary == NAMES


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("category_id", pa.array([0, 1], pa.int64())),
        ("category_id", pa.array([0, None], pa.int32())),
        ("instance_id", pa.array(["a", "b"])),
        ("embedding", pa.array([[1.0], [2.0]], pa.list_(pa.float32()))),
        ("embedding", pa.array([[1.0], [2.0]], pa.list_(pa.float64(), 1))),
        ("embedding", pa.array([[1.0], None], pa.list_(pa.float32(), 1))),
        ("columns", pa.array([0, 1])),
    ],
)
def test_column_of_another_type_is_named(tmp_path: Path, name: str, column: pa.Array) -> None:
    path = rewritten(tmp_path / "s.parquet", pa.table({name if name != "columns" else "kind": column}), GOOD)
    with pytest.raises(InputError) as caught:
        read_semantics(path)
    assert caught.value.field == name
