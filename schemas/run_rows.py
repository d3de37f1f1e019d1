"""Rows of some questions of a run, from the parts that hold them: a large run is not read whole for one question."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from schemas.committed import Committed, PartReader
from schemas.plan_columns import plan_table
from schemas.run_folder import to_frame
from schemas.tables import table_spec

if TYPE_CHECKING:
    import pandas as pd


class RunRows:
    """The rows a run had committed when this was made. Files read last are kept, so ask in plan order.

    Args:
        run: Run folder, a path or URI.

    Raises:
        InputError: There is no plan, it cannot be read, or a manifest is damaged.
    """

    def __init__(self, run: str) -> None:
        plan = plan_table(run, ["question_id", "unit"])
        self._unit_of = dict(zip(*(plan.column(name).to_pylist() for name in plan.column_names), strict=True))
        self._committed, self._reader = Committed.load(run), PartReader(run)

    def of(self, questions: Iterable[str], name: str, columns: tuple[str, ...] | None = None) -> pd.DataFrame:
        """Return a table's rows of questions, unit by unit and, within a unit, as `read_table` orders them.

        Args:
            questions: Their ids; one that is not committed, or not planned, has no rows.
            name: Table with a column question_id, such as "candidates".
            columns: Columns wanted, question_id among them; None for all.

        Raises:
            InputError: A part is damaged.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        spec, wanted = table_spec(name), list(questions)
        units = dict.fromkeys(self._unit_of[question] for question in wanted if question in self._unit_of)
        parts = [spec.conform(spec.arrow_schema().empty_table(), columns)]
        for unit in units:
            if unit in self._committed:
                table = self._committed.read(self._reader, unit, name, columns)
                parts.append(table.filter(pc.is_in(table.column("question_id"), value_set=pa.array(wanted))))
        return to_frame(spec, pa.concat_tables(parts))
