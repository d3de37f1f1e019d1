"""Every table a unit of work commits, in one place: those of questions, and those of captures that are built."""

from __future__ import annotations

from typing import Any

from schemas.answers import ANSWERS, ARMS
from schemas.builds import BUILDS
from schemas.calls import CALLS, REGIONS, TIMINGS
from schemas.clusterings import CLUSTERINGS
from schemas.errors import InputError
from schemas.evidence import CANDIDATES, CLUSTERS
from schemas.table import TableSpec

TABLES: dict[str, TableSpec[Any]] = {
    spec.name: spec for spec in (ANSWERS, ARMS, CLUSTERINGS, CLUSTERS, CANDIDATES, REGIONS, CALLS, TIMINGS)
}
"""Tables of questions by name. `calls` and `timings` hold what differs between runs; the others do not."""

ALL_TABLES: dict[str, TableSpec[Any]] = {**TABLES, BUILDS.name: BUILDS}
"""Every table a run may hold; a build run has `builds` and `timings`."""

MAIN_TABLES = (ANSWERS.name, BUILDS.name)
"""Tables with one row for each item that was planned, each with its status; a unit has rows in one of them."""

SAME_EVERY_RUN = ("answers", "arms")
"""Tables of questions that `aggregate` writes whole: the same job gives the same bytes, however often it was killed."""


def item_column(table: str) -> str:
    """Return the column that names the planned item a row belongs to."""
    return "scene" if table == BUILDS.name else "question_id"


def table_spec(name: str) -> TableSpec[Any]:
    """Return the table called `name`.

    Raises:
        InputError: There is no such table.
    """
    if name not in ALL_TABLES:
        raise InputError("run folder", field="table", expected=f"one of {', '.join(ALL_TABLES)}", found=repr(name))
    return ALL_TABLES[name]
