"""`splatreasoner retry`: questions that ended badly are done again."""

from __future__ import annotations

import sys
from typing import Annotated

import typer


def retry(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    error: Annotated[
        str, typer.Option(help="Failed questions with this error, such as RateLimitError; status lists them.")
    ] = "",
    status: Annotated[str, typer.Option(help="failed: whatever the error; unparsed: a reply stayed unreadable.")] = "",
    stage: Annotated[str, typer.Option(help="Only those where a call of this stage ended so, such as answer.")] = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be done again.")] = False,
) -> None:
    """Make failed or unparsed questions pending again; resume then does them, with the rest of their units.

    The others of a unit come out as they were: their calls are found among the stored replies.

    Example: [bold]splatreasoner retry demo/run --error RateLimitError && splatreasoner resume demo/run[/bold]
    """
    from jobs.runs.retry import retry

    def tell(text: str) -> None:
        print(text, file=sys.stderr)

    found = retry(run, error=error, status=status, stage=stage, dry_run=dry_run, told=tell)
    if not found.units:
        print(f"{run}: nothing to do again: no committed question ended so")
        return
    would = "would be" if dry_run else "are"
    print(f"{found.questions} questions {would} pending again, in {found.units} units")
    if found.others and found.stored:
        print(f"{found.others} other questions of these units are done again from stored replies and keep their rows")
    elif found.others:
        print(f"{found.others} other questions of these units are asked and paid again: the run stores no replies")
    if found.forgotten:
        print(f"{found.forgotten} replies that could not be read {would} forgotten")
    if not dry_run:
        print(f"results/ holds the old rows until then; go on with: splatreasoner resume {run}")
