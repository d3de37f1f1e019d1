"""Parts of earlier table versions are read with today's columns; those of later ones are refused."""

from __future__ import annotations

import dataclasses
import io
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.errors import InputError
from schemas.parts import WRITER, decode_part, encode_part
from schemas.plan import PLAN
from schemas.table import Added, TableSpec
from schemas.tables import TABLES

FIRST_COLUMNS = {
    "arms": "question_id scene task category method arm status reason answer views chosen frames mark mark_reason "
    "predicted targets iou region_gaussians",
    "answers": "question_id scene task category method question reference evidence activated clusters clusters_found "
    "status reason answer arm frames model",
    "calls": "question_id scene stage subject key endpoint model prompt_sha256 attempt outcome reply prompt_tokens "
    "completion_tokens latency_s cached",
    "candidates": "question_id scene cluster candidate move world_to_camera requested_m moved_m visibility source "
    "answer chosen",
}
"""Columns of version 1 of the tables that have had another since, as they were released."""

SAMPLES: dict[str, Any] = {
    "string": "text", "bool": True, "int32": 3, "int64": 1 << 40, "float64": 0.25, "list<string>": ["a", "b"],
    "list<float64>": [0.5], "list<int32>": [1], "list<int64>": [1],
}  # fmt: skip


def golden(name: str, version: int, columns: dict[str, str]) -> bytes:
    """A part as an older writer made it: its own columns and version, two rows."""
    fields = [pa.field(column, _type(text), text.endswith("?")) for column, text in columns.items()]
    schema = pa.schema(fields, metadata={"table": name, "version": str(version)})
    arrays = [pa.array([SAMPLES[text.removesuffix("?")]] * 2, _type(text)) for text in columns.values()]
    sink = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), sink, **WRITER)
    return sink.getvalue()


def _type(notation: str) -> pa.DataType:
    inner = notation.removesuffix("?")
    if inner.startswith("list<"):
        return pa.list_(pa.field("item", _type(inner[5:-1]), nullable=False))
    return {"string": pa.string(), "bool": pa.bool_(), "int32": pa.int32(), "int64": pa.int64()}.get(
        inner, pa.float64()
    )


@pytest.mark.parametrize("name", FIRST_COLUMNS)
def test_part_of_the_first_version_is_read_with_defaults(name: str) -> None:
    spec = TABLES[name]
    old = {column: spec.columns[column] for column in FIRST_COLUMNS[name].split()}
    table = decode_part(spec, golden(name, 1, old), "part")
    assert table.schema.equals(spec.arrow_schema(), check_metadata=True), "mixes with parts of today"
    rows = table.to_pylist()
    for column, text in spec.columns.items():
        expected = SAMPLES[text.removesuffix("?")] if column in old else spec.added[column].default
        expected = list(expected) if isinstance(expected, tuple) else expected
        assert [repr(row[column]) for row in rows] == [repr(expected)] * 2
    mixed = pa.concat_tables([table, spec.arrow_schema().empty_table()])
    again = decode_part(spec, encode_part(spec, spec.to_rows(mixed)), "again")
    assert repr(again.to_pylist()) == repr(rows), "equal, and nan is nan"


@pytest.mark.parametrize("name", TABLES)
def test_every_version_of_every_table_can_be_read(name: str) -> None:
    spec = TABLES[name]
    for version in range(1, spec.version + 1):
        columns = {c: t for c, t in spec.columns.items() if c not in spec.added or spec.added[c].version <= version}
        assert decode_part(spec, golden(name, version, columns), "part").num_rows == 2
    assert spec.version == 1 or spec.added, "a version that changes no column needs no number"


@pytest.mark.parametrize("spec", [*TABLES.values(), PLAN], ids=lambda spec: spec.name)
def test_part_of_a_later_version_is_refused_with_what_to_do(spec: TableSpec[Any]) -> None:
    later = golden(spec.name, spec.version + 1, {**spec.columns, "news": "string"})
    with pytest.raises(InputError, match=r"part: version: expected .*written by a newer splatreasoner"):
        decode_part(spec, later, "part")


def test_version_that_is_no_number_and_columns_of_another_version_are_refused() -> None:
    spec = TABLES["answers"]
    for version in ("", "-1", "0", "2.0", "²"):
        schema = spec.arrow_schema().with_metadata({"table": "answers", "version": version})
        with pytest.raises(InputError, match="part: version"):
            spec.check(schema, "part")
    with pytest.raises(InputError, match="the columns of answers version 1"):
        spec.check(spec.arrow_schema().with_metadata({"table": "answers", "version": "1"}), "part")


def test_column_cannot_come_without_a_default_or_from_the_future() -> None:
    spec = TABLES["answers"]
    with pytest.raises(ValueError, match="needs a default"):
        dataclasses.replace(spec, added={"calls_saved": Added(2)})
    with pytest.raises(ValueError, match="cannot have come with version 9"):
        dataclasses.replace(spec, added={"calls_saved": Added(9, 0)})


def test_columns_that_a_part_lacks_are_made_also_where_only_some_are_read() -> None:
    spec = TABLES["calls"]
    old = {column: spec.columns[column] for column in FIRST_COLUMNS["calls"].split()}
    table = decode_part(spec, golden("calls", 1, old), "part", columns=("prompt", "stage"))
    assert table.to_pylist() == [{"prompt": "", "stage": "text"}] * 2


def test_work_is_done_as_of_the_table_version_unless_a_later_one_only_notes_more() -> None:
    assert TABLES["answers"].work_version == TABLES["answers"].version
    assert (TABLES["calls"].version, TABLES["calls"].work_version) == (3, 2), "runs of version 2 go on"
    with pytest.raises(ValueError, match="as of version 9, of 3"):
        dataclasses.replace(TABLES["calls"], work=9)
