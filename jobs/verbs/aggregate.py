"""`splatreasoner aggregate`: the final tables and the scores of a run."""

from __future__ import annotations

from typing import Annotated

import typer

LINE_WIDTH = 160
"""Columns of a table where there is no terminal to ask: nothing is wrapped in a log."""


def aggregate(run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")]) -> None:
    """Write results/answers.parquet and results/arms.parquet and print the scores, always with their denominators.

    Example: [bold]splatreasoner aggregate demo/run[/bold]
    """
    show(run)


def show(run: str) -> None:
    """Write the final tables and print the scores."""
    from rich.console import Console

    from jobs.aggregate import aggregate
    from jobs.results import RESULTS, write_results
    from jobs.sheets import format_tables
    from schemas.storage import join

    rows = write_results(run)
    console = Console()
    if not console.is_terminal:
        console.width = LINE_WIDTH
    for table in format_tables(aggregate(run)):
        console.print(table)
        console.print()
    for name, count in rows.items():
        print(f"{join(run, RESULTS, name)}.parquet: {count} rows")
