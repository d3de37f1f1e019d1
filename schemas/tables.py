"""Every table a unit of work commits, in one place."""

from __future__ import annotations

from typing import Any

from schemas.answers import ANSWERS, ARMS
from schemas.calls import CALLS, REGIONS, TIMINGS
from schemas.clusterings import CLUSTERINGS
from schemas.errors import InputError
from schemas.evidence import CANDIDATES, CLUSTERS
from schemas.table import TableSpec

TABLES: dict[str, TableSpec[Any]] = {
    spec.name: spec for spec in (ANSWERS, ARMS, CLUSTERINGS, CLUSTERS, CANDIDATES, REGIONS, CALLS, TIMINGS)
}
"""Tables by name. `calls` and `timings` hold what differs between runs; the others do not."""

SAME_EVERY_RUN = ("answers", "arms")
"""Tables that `aggregate` writes whole: the same job gives the same bytes, however often it was killed."""


def table_spec(name: str) -> TableSpec[Any]:
    """Return the table called `name`.

    Raises:
        InputError: There is no such table.
    """
    if name not in TABLES:
        raise InputError("run folder", field="table", expected=f"one of {', '.join(TABLES)}", found=repr(name))
    return TABLES[name]
