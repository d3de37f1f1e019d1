"""`splatreasoner table`: a table of the paper, run by run, beside the paper's own figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from jobs.tables.table_file import Table


def table(
    file: Annotated[str, typer.Argument(help="Table file, YAML, or the name of a preset.", metavar="FILE|NAME")],
    rows: Annotated[str, typer.Option(help="Rows to run, with commas; all of them by default.", metavar="NAMES")] = "",
    output: Annotated[
        str | None,
        typer.Option(help="Folder of tables, in place of the file's; their runs share what is stored there."),
    ] = None,
    scenes: Annotated[list[str] | None, typer.Option(help="Scenes in place of the base's; may be repeated.")] = None,
    limit: Annotated[int | None, typer.Option(help="First questions of each scene to keep.", min=1)] = None,
    in_process: Annotated[bool, typer.Option("--in-process", help="Without Ray.")] = False,
    show: Annotated[bool, typer.Option("--show", help="Run nothing; print what there is.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print as CSV, a line a cell.")] = False,
    as_latex: Annotated[bool, typer.Option("--latex", help="Print as LaTeX.")] = False,
    list_rows: Annotated[bool, typer.Option("--list", help="Print the rows and what they change.")] = False,
) -> None:
    """Run the rows of a table that are not done and print it in the paper's layout, ours beside the paper's figures.

    Rows share stored replies and visibility, so each costs its difference only. A table that was stopped goes on.

    Examples: [bold]splatreasoner table em-eqa --scenes 'demo/scenes/*' --output runs/tables[/bold]

    [bold]splatreasoner table score-function --show --latex > score.tex[/bold]
    """
    import os

    from jobs.tables.table_file import load_table
    from schemas.errors import InputError
    from schemas.storage import local_path

    if as_csv and as_latex:
        raise InputError("table", expected="one of --csv and --latex", found="both")
    settings: dict[str, Any] = {}
    if scenes:
        settings["scenes"] = [name if local_path(name) is None else os.path.abspath(name) for name in scenes]
    if limit is not None:
        settings["limit"] = limit
    if in_process:
        settings["workers"] = {"in_process": True}
    found = load_table(file, output=output, settings=settings)
    if (show or list_rows) and not settings:
        from jobs.tables.table_run import as_last_run

        found = as_last_run(found)
    if list_rows:
        _list(found)
        return
    names = tuple(name.strip() for name in rows.split(",")) if rows else ()
    stopped = False if show else _run(found, names)
    print_table(found, as_csv=as_csv, as_latex=as_latex)
    if stopped:
        from jobs.runs.signals import STOPPED

        raise typer.Exit(STOPPED)


def print_table(found: Table, *, as_csv: bool = False, as_latex: bool = False) -> None:
    """Print what there is of a table, in text unless told otherwise."""
    import pandas as pd

    from jobs.frame_text import to_csv, to_latex, to_text
    from jobs.tables.table_scores import cell_rows, table_cells
    from jobs.tables.table_text import notes, parts_of, table_frame

    cells = table_cells(found)
    if as_csv:
        print(to_csv(pd.DataFrame(cell_rows(found, cells))), end="")
        return
    told = notes(found, cells)
    if as_latex:
        print(to_latex(table_frame(found, cells), ["Method"], told), end="")
        return
    print(told[0])
    for part in parts_of(found):
        print(*([] if part is None else [f"\n{part}"]), to_text(table_frame(found, cells, (part,))), sep="\n")
    for note in told[1:]:
        print(note)


def _run(found: Table, rows: tuple[str, ...]) -> bool:
    """Do the runs; return whether someone asked to stop."""
    import sys

    from jobs.runs.progress import for_terminal
    from jobs.tables.table_run import run_table

    result = run_table(found, rows, progress=for_terminal)
    if result.complete:
        return False
    print(f"{len(result.done)} of {result.wanted} runs begun; the same command goes on", file=sys.stderr)
    return True


def _list(found: Table) -> None:
    for name, row in found.config.rows.items():
        if row.change is not None:
            told = f"changes {row.change}" if row.change else "the base"
            told += "".join(f"\n  {found.place(run)}" for run in found.runs_of(name))
        else:
            told = "the paper's figures alone" if row.run is None else f"arm {row.arm} of {row.run}"
        print(f"{name}: {row.label}: {told}")
