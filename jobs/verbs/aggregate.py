"""`splatreasoner aggregate`: the final tables and the scores of a run."""

from __future__ import annotations

from typing import Annotated

import typer

LINE_WIDTH = 160
"""Columns of a table where there is no terminal to ask: nothing is wrapped in a log."""

DEFAULT_ACC = "8,10"
"""The paper's thresholds."""

SHOWN = ("metric", "mean", "low", "high", "scored", "questions", "answered", "unparsed", "failed", "skipped", "pending")
"""Columns of a grouped table in the terminal and in LaTeX; CSV and JSON have all."""


def aggregate(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    by: Annotated[
        str, typer.Option(help="One table by these, with commas: task, category, scene, method, arm.", metavar="NAMES")
    ] = "",
    acc: Annotated[str, typer.Option(help="Thresholds of Acc@k, percent, with commas.", metavar="K,K")] = DEFAULT_ACC,
    marks: Annotated[
        str, typer.Option(help="OpenEQA metrics file of another judge, in place of the run's marks.", metavar="FILE")
    ] = "",
    arm: Annotated[str, typer.Option(help="Whose answers the marks are: verified, final or initial.")] = "verified",
    table: Annotated[
        str, typer.Option(help="Table file or preset whose runs lie in the folder RUN, see table.", metavar="FILE|NAME")
    ] = "",
    as_csv: Annotated[bool, typer.Option("--csv", help="As CSV on standard output.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON on standard output.")] = False,
    as_latex: Annotated[bool, typer.Option("--latex", help="As a LaTeX table on standard output.")] = False,
) -> None:
    """Write results/answers.parquet and results/arms.parquet and print the scores, always with their denominators.

    With any option nothing is written and one table is printed: a row a group, arm and metric.

    Examples: [bold]splatreasoner aggregate demo/run[/bold]

    [bold]splatreasoner aggregate demo/run --by task,category --csv > scores.csv[/bold]

    [bold]splatreasoner aggregate runs/tables --table em-eqa --latex > em-eqa.tex[/bold]
    """
    from schemas.errors import InputError

    if as_csv + as_json + as_latex > 1:
        raise InputError("aggregate", expected="one of --csv, --json and --latex", found="several")
    if table:
        if by or marks or as_json:
            raise InputError("--table", expected="with --csv or --latex at most", found="other options")
        from jobs.tables.table_file import load_table
        from jobs.tables.table_run import as_last_run
        from jobs.verbs.table import print_table

        print_table(as_last_run(load_table(table, output=run)), as_csv=as_csv, as_latex=as_latex)
        return
    if not (by or marks or as_csv or as_json or as_latex) and acc == DEFAULT_ACC:
        show(run)
        return
    import sys

    from jobs.frame_text import to_csv, to_json, to_latex, to_text
    from jobs.scoring.aggregate import coverage, grouped_scores
    from jobs.scoring.scores import Options

    covered = coverage(run)
    if marks:
        from jobs.scoring.marks import read_marks, with_marks

        remarked = with_marks(covered, read_marks(marks), arm)
        covered = remarked.covered
        print(f"{marks}: {remarked.used} marks used, {remarked.others} of other questions", file=sys.stderr)
    names = [name.strip() for name in by.split(",")] if by else []
    rows, notice = grouped_scores(covered, names, Options(_percents(acc))), covered.notice()
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
    print(to_csv(rows) if as_csv else to_text(rows[[*words[:-1], *SHOWN]]), end="\n" if not as_csv else "")


def _percents(text: str) -> tuple[float, ...]:
    from schemas.errors import InputError

    try:
        return tuple(map(float, text.split(",")))
    except ValueError as error:
        raise InputError("--acc", expected="numbers with commas, such as 8,10", found=text) from error


def show(run: str) -> None:
    """Write the final tables and print the scores."""
    from rich.console import Console

    from jobs.runs.results import RESULTS, write_results
    from jobs.scoring.aggregate import aggregate
    from jobs.scoring.coverage import notice
    from jobs.scoring.sheets import format_tables
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
