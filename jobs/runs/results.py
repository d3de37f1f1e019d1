"""The final tables: every committed row in plan order, one file a table, the same bytes however the run came about."""

from __future__ import annotations

import tempfile
from pathlib import Path

from schemas import storage
from schemas.builds import BUILDS
from schemas.parts import write_stream
from schemas.run_folder import RunFolder
from schemas.tables import SAME_EVERY_RUN, table_spec

RESULTS = "results"


def write_results(run: str) -> dict[str, int]:
    """Write results/answers.parquet and arms.parquet, or builds.parquet, from all committed parts; return their rows.

    Raises:
        InputError: No such run, or a part is damaged.
    """
    folder, written = RunFolder(run), {}
    for name in (BUILDS.name,) if folder.builds() else SAME_EVERY_RUN:
        uri = folder.uri(RESULTS, f"{name}.parquet")
        path = storage.local_path(uri)
        if path is not None:
            written[name] = write_stream(table_spec(name), folder.parts(name), path)
        else:
            with tempfile.TemporaryDirectory(prefix="splatreasoner-") as place:
                aside = Path(place, f"{name}.parquet")
                written[name] = write_stream(table_spec(name), folder.parts(name), aside)
                storage.write_bytes_atomic(uri, aside.read_bytes())
    return written
