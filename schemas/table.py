"""What a table is: a record type, its explicit Arrow schema, its version and its key.

Column types are written in a small notation, so that declaring a table does not import pyarrow (the command line's
help must be instant): a scalar name such as "string", "list<...>" of one, and a trailing "?" where null is allowed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from schemas.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

R = TypeVar("R")

SCALARS = ("string", "bool", "int32", "int64", "float64")
"""Scalar column types: all that the tables need, each with one obvious pandas type."""


@dataclass(frozen=True, slots=True)
class TableSpec(Generic[R]):
    """A table on disk.

    Raises:
        ValueError: A column's notation is unknown, or columns and record fields differ.
    """

    name: str
    """Folder of its parts in a run, and what `read_table` is asked for."""
    version: int
    """Raised when a column is added, dropped or changes its meaning; stored in every part."""
    record: type[R]
    """The dataclass of one row."""
    columns: Mapping[str, str]
    """Column name to type notation, in the order of the record's fields."""
    key: tuple[str, ...]
    """Columns that tell one row from every other in a run."""

    def __post_init__(self) -> None:
        fields = [field.name for field in dataclasses.fields(self.record)]  # type: ignore[arg-type]
        if fields != list(self.columns):
            raise ValueError(f"table {self.name}: columns {list(self.columns)} differ from record fields {fields}")
        for column, notation in self.columns.items():
            inner = notation.removesuffix("?").removeprefix("list<").removesuffix(">")
            if inner not in SCALARS:
                raise ValueError(f"table {self.name}: column {column} has unknown type {notation!r}")

    def arrow_schema(self) -> pa.Schema:
        """Return the Arrow schema, with the table's name and version in its metadata."""
        import pyarrow as pa

        fields = [pa.field(name, _arrow_type(text), text.endswith("?")) for name, text in self.columns.items()]
        return pa.schema(fields, metadata={"table": self.name, "version": str(self.version)})

    def to_arrow(self, rows: Iterable[R]) -> pa.Table:
        """Return the rows as one Arrow table.

        Raises:
            ValueError: A value is null or of another type where the column does not allow it.
        """
        import pyarrow as pa

        schema, kept = self.arrow_schema(), list(rows)
        arrays = []
        for field in schema:
            try:
                array = pa.array([getattr(row, field.name) for row in kept], field.type)
            except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
                raise ValueError(f"table {self.name}: column {field.name}: {error}") from error
            nulls = 0 if field.nullable else array.null_count
            if pa.types.is_list(field.type):
                nulls += array.flatten().null_count
            if nulls:
                raise ValueError(f"table {self.name}: column {field.name} has {nulls} nulls, expected none")
            arrays.append(array)
        return pa.Table.from_arrays(arrays, schema=schema)

    def to_rows(self, table: pa.Table) -> list[R]:
        """Return the records of an Arrow table with this schema."""
        columns = []
        for name, notation in self.columns.items():
            values = table.column(name).to_pylist()
            if notation.startswith("list<"):
                values = [None if value is None else tuple(value) for value in values]
            columns.append(values)
        build: Any = self.record
        return [build(*values) for values in zip(*columns, strict=True)]

    def check(self, schema: pa.Schema, subject: object) -> None:
        """Refuse a part that was not written as this table.

        Raises:
            InputError: Name, version or a column differs.
        """
        metadata = schema.metadata or {}
        for field, expected in (("table", self.name), ("version", str(self.version))):
            found = metadata.get(field.encode(), b"").decode(errors="replace")
            if found != expected:
                raise InputError(subject, field=field, expected=expected, found=found or "nothing")
        expected_schema = self.arrow_schema()
        if not schema.equals(expected_schema, check_metadata=False):
            wrong = [f.name for f in expected_schema if f.name not in schema.names or schema.field(f.name) != f]
            raise InputError(
                subject,
                field=wrong[0] if wrong else "columns",
                expected=f"the columns of {self.name} version {self.version}",
                found=f"columns {', '.join(schema.names)}",
            )


def _arrow_type(notation: str) -> pa.DataType:
    import pyarrow as pa

    scalars = {
        "string": pa.string(),
        "bool": pa.bool_(),
        "int32": pa.int32(),
        "int64": pa.int64(),
        "float64": pa.float64(),
    }
    inner = notation.removesuffix("?")
    if inner.startswith("list<"):
        return pa.list_(pa.field("item", scalars[inner[5:-1]], nullable=False))
    return scalars[inner]
