"""`splatreasoner export`: a run's answers for other programs."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Format(StrEnum):
    """What is written."""

    OPENEQA = "openeqa"
    CSV = "csv"
    JSONL = "jsonl"


def export(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    output: Annotated[str, typer.Option(help="File to write, a path or URI.")],
    form: Annotated[
        Format,
        typer.Option("--format", help="openeqa: results and metrics JSON of its tool; csv, jsonl: a row a question."),
    ] = Format.OPENEQA,
    arm: Annotated[str, typer.Option(help="Whose answers: verified, final or initial.")] = "verified",
) -> None:
    """Write the answers of a run; questions without one are listed beside the file and never given one.

    Example: [bold]splatreasoner export demo/run --format openeqa --output results.json[/bold]
    """
    from jobs.scoring.export import export_run

    done = export_run(run, form.value, output, arm=arm)
    print(f"{done.answered} of {done.planned} questions answered, {done.scored} scored")
    for file in done.files:
        print(file)
    if done.unanswered and form is Format.OPENEQA:
        print(f"{done.unanswered} ended without an answer: null in the file, which OpenEQA's tool scores 0")
    if done.pending:
        print(
            f"INCOMPLETE: {done.pending} questions are pending and in no file; go on with: splatreasoner resume {run}"
        )
