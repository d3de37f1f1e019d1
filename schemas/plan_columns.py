"""The plan by columns: a million questions are read in a fraction of a second when nobody needs them as records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from schemas import storage
from schemas.build_plan import BUILD_PLAN
from schemas.errors import InputError
from schemas.plan import PLAN, PLAN_FILE

if TYPE_CHECKING:
    import pyarrow as pa


def plan_table(run: str, columns: Sequence[str]) -> pa.Table:
    """Return columns of a run's plan, of questions or of captures, in plan order.

    Raises:
        InputError: There is no plan, it is not one of this version, or it is of captures and has no such column.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    uri = storage.join(run, PLAN_FILE)
    if not storage.exists(uri):
        raise InputError(run, expected=f"a run folder with {PLAN_FILE}", found="none")
    with storage.local_copy(uri) as path:
        try:
            with pq.ParquetFile(path, page_checksum_verification=True) as file:
                schema = file.schema_arrow
                named = (schema.metadata or {}).get(b"table") == BUILD_PLAN.name.encode()
                (BUILD_PLAN if named else PLAN).check(schema, uri)
                if named and not set(columns) <= set(BUILD_PLAN.columns):
                    raise InputError(run, expected="a run that answers questions", found="one that builds scenes")
                return file.read(list(columns))
        except (pa.ArrowException, OSError) as error:
            raise InputError(uri, expected="a readable plan", found=str(error).splitlines()[0]) from error


def unit_sizes(run: str) -> dict[str, int]:
    """Return the questions, or captures, of each unit of a run, by unit id, in plan order.

    Raises:
        InputError: As `plan_table`.
    """
    counted = plan_table(run, ["unit"]).column("unit").value_counts()
    return {entry["values"]: entry["counts"] for entry in counted.to_pylist()}
