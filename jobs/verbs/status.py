"""`splatreasoner status`: how far a run is."""

from __future__ import annotations

from typing import Annotated

import typer


def status(run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")]) -> None:
    """Say how far a run is: units, questions, rate, time left, failures by error.

    Example: [bold]splatreasoner status demo/run[/bold]
    """
    from jobs.status import run_status

    found = run_status(run)
    state = "complete" if found.complete else "running" if found.running else "not running"
    print(f"{found.name}: {state}")
    print(f"units: {found.units_done} of {found.units} committed")
    print(f"questions: {found.questions_done} of {found.questions} committed")
    for name, count in sorted(found.statuses.items()):
        print(f"  {name}: {count}")
    if found.per_minute is not None and not found.complete:
        print(f"rate: {found.per_minute:.1f} questions a minute, {found.minutes_left:.1f} minutes left")
    if found.retries:
        print(f"tries beyond the first: {found.retries}")
    for reason, count in found.reasons.items():
        print(f"  {count} failed: {reason}")
    if not found.complete and not found.running:
        print(f"go on with: splatreasoner resume {run}")
