"""`splatreasoner report`: a run as one page to look at."""

from __future__ import annotations

from typing import Annotated

import typer


def report(run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")]) -> None:
    """Write report.html into a run: scores, and for every question what led to its answer.

    Example: [bold]splatreasoner report demo/run[/bold]
    """
    from jobs.report import write_report

    print(write_report(run))
