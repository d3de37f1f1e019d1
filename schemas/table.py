"""What a table is: a record type, its explicit Arrow schema, its version and its key.

Column types are written in a small notation, so that declaring a table does not import pyarrow (the command line's
help must be instant): a scalar name such as "string", "list<...>" of one, and a trailing "?" where null is allowed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from schemas.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

R = TypeVar("R")

SCALARS = ("string", "bool", "int32", "int64", "float64")
"""Scalar column types: all that the tables need, each with one obvious pandas type."""


@dataclass(frozen=True, slots=True)
class Added:
    """When a column came, and what older parts hold in its place."""

    version: int
    """First table version with the column."""
    default: Any = None
    """Value of rows written before; None where the column allows null."""


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
    added: Mapping[str, Added] = field(default_factory=dict)
    """Columns that version 1 did not have. Columns are only ever added, so every older part can be read."""
    work: int | None = None
    """Version that unit ids depend on: the last that had rows say another thing of the same work. A run goes on under
    later ones, which only note more of it. None for `version`."""

    def __post_init__(self) -> None:
        fields = [field.name for field in dataclasses.fields(self.record)]  # type: ignore[arg-type]
        if fields != list(self.columns):
            raise ValueError(f"table {self.name}: columns {list(self.columns)} differ from record fields {fields}")
        for column, change in self.added.items():
            if column not in self.columns or not 1 < change.version <= self.version:
                raise ValueError(f"table {self.name}: column {column} cannot have come with version {change.version}")
            if change.default is None and not self.columns[column].endswith("?"):
                raise ValueError(f"table {self.name}: column {column} needs a default for older rows")
        if self.work is not None and not 0 < self.work <= self.version:
            raise ValueError(f"table {self.name}: work is done as of version {self.work}, of {self.version}")
        for column, notation in self.columns.items():
            inner = notation.removesuffix("?").removeprefix("list<").removesuffix(">")
            if inner not in SCALARS:
                raise ValueError(f"table {self.name}: column {column} has unknown type {notation!r}")

    @property
    def work_version(self) -> int:
        """The version that unit ids depend on."""
        return self.version if self.work is None else self.work

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
        for column in schema:
            try:
                array = pa.array([getattr(row, column.name) for row in kept], column.type)
            except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
                raise ValueError(f"table {self.name}: column {column.name}: {error}") from error
            nulls = 0 if column.nullable else array.null_count
            if pa.types.is_list(column.type):
                nulls += array.flatten().null_count
            if nulls:
                raise ValueError(f"table {self.name}: column {column.name} has {nulls} nulls, expected none")
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
        """Refuse a part that was not written as this table, in this version or an older one.

        Raises:
            InputError: The name or a column differs, or the version is unknown.
        """
        metadata = schema.metadata or {}
        name = metadata.get(b"table", b"").decode(errors="replace")
        if name != self.name:
            raise InputError(subject, field="table", expected=self.name, found=name or "nothing")
        version = metadata.get(b"version", b"").decode(errors="replace")
        if version not in map(str, range(1, self.version + 1)):
            newer = " (written by a newer splatreasoner)" if version.isdecimal() else ""
            expected = str(self.version) if self.version == 1 else f"1 to {self.version}"
            raise InputError(subject, field="version", expected=expected, found=f"{version or 'nothing'}{newer}")
        fields = [
            f for f in self.arrow_schema() if f.name not in self.added or self.added[f.name].version <= int(version)
        ]
        if list(schema) != fields:
            wrong = [f.name for f in fields if f.name not in schema.names or schema.field(f.name) != f]
            raise InputError(
                subject,
                field=wrong[0] if wrong else "columns",
                expected=f"the columns of {self.name} version {version}",
                found=f"columns {', '.join(schema.names)}",
            )

    def conform(self, table: pa.Table, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the rows of a part that `check` has passed with today's columns: new ones hold what `added` says.

        Args:
            table: The rows.
            columns: Columns wanted; None for all.
        """
        import pyarrow as pa

        schema = self.arrow_schema()
        fields = [schema.field(name) for name in (schema.names if columns is None else columns)]
        arrays = [
            table.column(field.name)
            if field.name in table.column_names
            else pa.array([self.added[field.name].default] * table.num_rows, field.type)
            for field in fields
        ]
        return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=schema.metadata))


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
