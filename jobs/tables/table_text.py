"""A table as people read it, in the paper's layout: a row's figures, below them the paper's, below them intervals."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from jobs.scoring.scores import COUNTED
from jobs.tables.table_file import Column, Table
from jobs.tables.table_scores import Cell
from pipeline.metrics.significance import FEW_SCENES

PAPER, INTERVAL, ZERO = "  paper", "  95 %", "  if 0"
NOTHING = "–"


def table_frame(table: Table, cells: list[Cell], parts: tuple[str | None, ...] = ()) -> pd.DataFrame:
    """Return the table as texts: lines for a row's figures, for the paper's, for intervals and for zeros.

    The last columns say how many questions were scored of those planned, one for each part.

    Args:
        table: The table.
        cells: From `table_cells`.
        parts: Parts to keep; empty for all.
    """
    config, parts = table.config, parts or parts_of(table)
    columns = {name: column for name, column in config.columns.items() if column.part in parts}
    lines = []
    for name, row in config.rows.items():
        own = {cell.column: cell for cell in cells if cell.row == name and cell.column in columns}
        if not own:
            continue
        ours = [figure(own[column], shown) for column, shown in columns.items()]
        lines.append([row.label, *ours, *_denominators(columns, parts, own)])
        blank = [""] * len(parts)
        if row.reference.keys() & columns:
            told = [_told(row.reference.get(column), shown) for column, shown in columns.items()]
            lines.append([PAPER, *told, *blank])
        if any(cell.low is not None for cell in own.values()):
            ends = [_interval(own[column], shown) for column, shown in columns.items()]
            lines.append([INTERVAL, *ends, *blank])
        if any(_differs(cell) for cell in own.values()):
            zeros = [_number(own[column].zero, shown) for column, shown in columns.items()]
            lines.append([ZERO, *zeros, *blank])
    several = len(parts) > 1
    headers = [f"{column.part}: {column.label}" if several else column.label for column in columns.values()]
    scored = [f"scored {part}" if several else "scored" for part in parts]
    return pd.DataFrame(lines, columns=pd.Index(["Method", *headers, *scored]))


def notes(table: Table, cells: list[Cell]) -> list[str]:
    """Return what has to be known to read the table."""
    told = [f"{table.config.name}: {table.config.caption}".rstrip(": ")]
    measured = [cell for cell in cells if cell.runs]
    if measured:
        text = "Means over the scored questions; 95 % bootstrap intervals over scenes and then questions"
        if any(cell.runs > 1 for cell in measured):
            text += "; with +- the sample standard deviation over runs (n - 1)"
        told.append(text + ".")
    if any(column.value == "p" for column in table.config.columns.values()):
        told.append(
            "p: Student's paired t test over questions, each with its mean over runs (our reading of the paper)."
        )
    if any(_differs(cell) for cell in measured):
        told.append("if 0: with 0 for each question that ended without a score, as OpenEQA counts a missing answer.")
    few = {cell.scenes for cell in measured if 1 < cell.scenes < FEW_SCENES}
    if few:
        told.append(f"{max(few)} scenes are too few for an interval to speak of others.")
    if any(cell.scenes == 1 for cell in measured):
        told.append("With one scene an interval draws questions alone, and speaks of this scene only.")
    for cell in measured:
        if cell.pending:
            label = table.config.rows[cell.row].label
            told.append(f"INCOMPLETE: {label}: {cell.pending} of {cell.questions} questions are pending, in no mean.")
    nothing = [
        name
        for name in dict.fromkeys(cell.row for cell in cells)
        if table.source(name) is not None and not any(cell.runs for cell in cells if cell.row == name)
    ]
    ended = {cell.row for cell in cells if cell.questions}
    if absent := [table.config.rows[name].label for name in nothing if name not in ended]:
        told.append(f"Not run: {', '.join(absent)}.")
    for name in nothing:
        if name in ended:
            why = table.place(table.runs_of(name)[0])
            told.append(f"No question was scored: {table.config.rows[name].label}; see: splatreasoner aggregate {why}")
    return list(dict.fromkeys(told))


def figure(cell: Cell, column: Column) -> str:
    """Return our figure, with its deviation where runs were repeated; a dash where there is none."""
    if cell.value is None:
        return NOTHING
    if column.value == "p":
        return f"{cell.value:.5f}"
    text = _number(cell.value, column)
    return text if cell.std is None else f"{text} ± {cell.std:.2f}"


def _told(reference: float | str | None, column: Column) -> str:
    return _number(reference, column) if isinstance(reference, float) else "" if reference is None else str(reference)


def _number(value: float | None, column: Column) -> str:
    return "" if value is None else f"{value:.{column.digits}f}"


def _differs(cell: Cell) -> bool:
    """Whether questions that ended without a score would change the figure."""
    return cell.zero is not None and cell.value is not None and abs(cell.zero - cell.value) > 1e-9


def _interval(cell: Cell, column: Column) -> str:
    if cell.low is None or cell.high is None:
        return ""
    return f"{cell.low:.{column.digits}f} … {cell.high:.{column.digits}f}"


def parts_of(table: Table) -> tuple[str | None, ...]:
    """Return the parts that columns show, in order; None alone for a table without."""
    return tuple(dict.fromkeys(column.part for column in table.config.columns.values()))


def _denominators(columns: Mapping[str, Column], parts: tuple[str | None, ...], own: dict[str, Cell]) -> list[str]:
    """Questions scored in each part, by its first column that is a score: a count such as frames may know more."""
    found = []
    for part in parts:
        shown = [name for name, column in columns.items() if column.part == part]
        scores = [name for name in shown if columns[name].metric not in COUNTED]
        cell = own[(scores or shown)[0]]
        found.append(f"{cell.scored} of {cell.questions}" if cell.questions else NOTHING)
    return found
