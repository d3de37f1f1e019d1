"""`splatreasoner aggregate`: the final tables and the scores of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pandas import DataFrame

LINE_WIDTH = 160
"""Columns of a table where there is no terminal to ask: nothing is wrapped in a log."""

SHOWN = ("metric", "mean", "low", "high", "scored", "questions", "answered", "unparsed", "failed", "skipped", "pending")
"""Columns of a grouped table in the terminal and in LaTeX; CSV and JSON have all."""


def aggregate(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    by: Annotated[
        str, typer.Option(help="One table by these, with commas: task, category, scene, method, arm.", metavar="NAMES")
    ] = "",
    as_csv: Annotated[bool, typer.Option("--csv", help="As CSV on standard output.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON on standard output.")] = False,
    as_latex: Annotated[bool, typer.Option("--latex", help="As a LaTeX table on standard output.")] = False,
) -> None:
    """Write results/answers.parquet and results/arms.parquet and print the scores, always with their denominators.

    With --by, --csv, --json or --latex nothing is written and one table is printed: a row a group, arm and metric.

    Examples: [bold]splatreasoner aggregate demo/run[/bold]

    [bold]splatreasoner aggregate demo/run --by task,category --csv > scores.csv[/bold]
    """
    from schemas.errors import InputError

    if as_csv + as_json + as_latex > 1:
        raise InputError("aggregate", expected="one of --csv, --json and --latex", found="several")
    if not (by or as_csv or as_json or as_latex):
        show(run)
        return
    import sys

    from jobs.aggregate import coverage, grouped_scores
    from jobs.frame_text import to_csv, to_json, to_latex

    covered = coverage(run)
    names = [name.strip() for name in by.split(",")] if by else []
    rows, notice = grouped_scores(covered, names), covered.notice()
    words = [*rows.columns[: list(rows.columns).index("metric")], "metric"]
    if as_json:
        counts = {"run": run, "complete": not covered.pending, "planned": covered.planned, "pending": covered.pending}
        print(to_json({**counts, "scores": rows}))
        return
    if as_latex:
        note = f"{run}: means of the scored questions, 0 to 100; 95 % intervals by bootstrap over scenes and questions"
        print(to_latex(rows[[*words[:-1], *SHOWN]], words, [note, *([notice] if notice else [])]), end="")
        return
    if notice:
        print(notice, file=sys.stderr if as_csv else sys.stdout)
    print(to_csv(rows) if as_csv else format_frame(rows[[*words[:-1], *SHOWN]]), end="\n" if not as_csv else "")


def show(run: str) -> None:
    """Write the final tables and print the scores."""
    from rich.console import Console

    from jobs.aggregate import aggregate
    from jobs.coverage import notice
    from jobs.results import RESULTS, write_results
    from jobs.sheets import format_tables
    from schemas.storage import join

    rows = write_results(run)
    console = Console()
    if not console.is_terminal:
        console.width = LINE_WIDTH
    frames = aggregate(run)
    ended = frames["outcomes"].groupby("status")["questions"].sum()
    if told := notice(int(ended.sum()), int(ended.get("pending", 0))):
        console.print(told, style="bold", markup=False, highlight=False)
    for table in format_tables(frames):
        console.print(table)
        console.print()
    for name, count in rows.items():
        print(f"{join(run, RESULTS, name)}.parquet: {count} rows")


def format_frame(frame: DataFrame) -> str:
    """Return a frame as text with aligned columns; a dash stands for nothing."""
    from jobs.frame_text import to_records

    rows = [[_cell(value) for value in record.values()] for record in to_records(frame)]
    table = [[str(name).replace("_", " ") for name in frame.columns], *rows]
    numbers = [all(not isinstance(value, str) for value in frame[name]) for name in frame.columns]
    widths = [max(len(row[place]) for row in table) for place in range(len(frame.columns))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(row, widths, numbers, strict=True)
        ).rstrip()
        for row in table
    )


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:,.2f}" if isinstance(value, float) else str(value)
