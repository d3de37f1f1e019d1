"""`splatreasoner aggregate`: the final tables and the scores of a run."""

from __future__ import annotations

from typing import Annotated

import typer


def aggregate(run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")]) -> None:
    """Write results/answers.parquet and results/arms.parquet and print the scores, always with their denominators.

    Example: [bold]splatreasoner aggregate demo/run[/bold]
    """
    show(run)


def show(run: str) -> None:
    """Write the final tables and print the scores."""
    from jobs.aggregate import aggregate
    from jobs.frames import print_frame
    from jobs.results import RESULTS, write_results
    from schemas.storage import join

    rows = write_results(run)
    for title, frame in aggregate(run).items():
        print_frame(title.replace("_", " "), frame)
    print(", ".join(f"{join(run, RESULTS, name)}.parquet: {count} rows" for name, count in rows.items()))
