"""From a table's runs to its cells: every figure with its interval, its denominator and the paper's beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from jobs.scoring.aggregate import coverage
from jobs.scoring.cost_rows import COST_METRICS, cost_of, cost_rows
from jobs.scoring.coverage import Coverage
from jobs.scoring.scores import ARMS, COUNTED, PENDING, Options, in_order, score_rows, scored_ends
from jobs.tables.table_file import LAST, Column, Table, TableRun
from pipeline.metrics.stability import mean_by_question, over_runs, paired_t
from schemas.calls import CALL_FIGURES
from schemas.errors import InputError
from schemas.run_folder import RunFolder, read_table


@dataclass(frozen=True, slots=True)
class Cell:
    """One figure of a table."""

    row: str
    """Row."""
    column: str
    """Column."""
    value: float | None
    """The figure; None where nothing is scored, or the run is not there."""
    zero: float | None
    """The same were every question that ended without a score 0, as a missing answer is in OpenEQA; None for counts."""
    std: float | None
    """Sample standard deviation over repeated runs; None for one."""
    low: float | None
    """Lower end of the 95 % interval, scenes drawn and then questions."""
    high: float | None
    """Upper end."""
    scenes: int
    """Scenes it was taken over."""
    scored: int
    """Questions it was taken over."""
    questions: int
    """Questions planned that the metric is about, in one run."""
    pending: int
    """Of these, not committed, over all runs."""
    runs: int
    """Repeated runs it was taken over."""
    reference: float | str | None
    """The paper's."""


@dataclass(frozen=True, slots=True)
class _Run:
    covered: Coverage
    scores: pd.DataFrame
    costs: pd.DataFrame


def table_cells(table: Table, options: Options | None = None) -> list[Cell]:
    """Return the cells of the rows that are shown, row by row; runs that are not there leave theirs empty.

    Raises:
        InputError: A run is damaged or lacks an arm.
    """
    options = options or Options()
    percents = {c.metric[4:] for c in table.config.columns.values() if c.metric.startswith("acc@")}
    options = Options(tuple(map(float, sorted(percents, key=float))), options.level, options.resamples, options.seed)
    book = _Book(table, options)
    return [
        book.cell(row, column)
        for row, shown in table.config.rows.items()
        if not shown.hidden
        for column in table.config.columns
    ]


class _Book:
    """The runs of a table, each read once."""

    def __init__(self, table: Table, options: Options) -> None:
        self._table, self._options = table, options
        self._read: dict[str, _Run | None] = {}

    def cell(self, row: str, name: str) -> Cell:
        column, reference = self._table.config.columns[name], self._table.config.rows[row].reference.get(name)
        source = column.of or row
        runs = self._scores(source, column)
        planned = max((len(run) for run in runs), default=0)
        pending = sum(int((run["status"] == PENDING).sum()) for run in runs if "status" in run)
        empty = Cell(row, name, None, None, None, None, None, 0, 0, planned, pending, len(runs), reference)
        if not runs or row == column.against:
            return empty
        scores = _by_question(runs)
        if column.value == "p":
            assert column.against is not None
            others = self._scores(column.against, column)
            if not others:
                return empty
            other = _by_question(others)["score"].reindex(scores.index).to_numpy("float64")
            test = paired_t(other, scores["score"].to_numpy("float64"))
            return replace(empty, value=test.p, scored=test.pairs)
        means = [float(run["score"].mean()) for run in runs if run["score"].notna().any()]
        over = over_runs(means)
        key = (self._table.config.name, row, name)
        ends = scored_ends(scores["score"].to_numpy("float64"), scores["scene"], key, self._options)
        return replace(
            empty,
            value=over.mean,
            zero=_zero(runs) if "ended" in runs[0] and column.metric not in COUNTED else None,
            std=over.std,
            low=ends["low"],
            high=ends["high"],
            scenes=ends["scenes"],
            scored=int(scores["score"].notna().sum()),
            runs=over.runs,
        )

    def _scores(self, row: str, column: Column) -> list[pd.DataFrame]:
        """One frame a run, by question: score and scene; of scores also status, and whether one could be had."""
        found = []
        for run in self._table.runs_of(row, column.part):
            read = self._run(run)
            if read is None:
                continue
            if column.metric.partition("@")[0] in COST_METRICS:
                rows = cost_of(read.costs, column.metric)
                if column.category is not None:
                    asked = read.covered.arms
                    rows = rows[rows["question_id"].isin(asked[asked["category"] == column.category]["question_id"])]
            else:
                arm = self._arm(row, run, read)
                rows = read.scores[(read.scores["arm"] == arm) & (read.scores["metric"] == column.metric)]
                rows = rows.assign(ended=rows["has_reference"] & (rows["status"] != PENDING))
                if column.category is not None:
                    rows = rows[rows["category"] == column.category]
            found.append(rows.set_index("question_id"))
        return [rows for rows in found if len(rows)]

    def _arm(self, row: str, run: TableRun, read: _Run) -> str:
        wanted, there = self._table.config.rows[row].arm, in_order(read.covered.arms["arm"], ARMS)
        if wanted == LAST:
            return there[-1]
        if wanted not in there:
            raise InputError(
                self._table.subject, field=f"rows.{row}.arm", expected=f"one of {', '.join(there)}", found=wanted
            )
        return wanted

    def _run(self, run: TableRun) -> _Run | None:
        place = self._table.place(run)
        if place not in self._read:
            self._read[place] = _read(place, self._options) if RunFolder(place).exists() else None
        return self._read[place]


def _read(place: str | Path, options: Options) -> _Run | None:
    covered = coverage(place)
    if covered.pending == covered.planned:
        return None
    costs = cost_rows(
        read_table(place, "answers"), read_table(place, "calls", CALL_FIGURES), read_table(place, "timings")
    )
    return _Run(covered, score_rows(covered.arms, covered.answers, options.thresholds), costs)


def _zero(runs: list[pd.DataFrame]) -> float | None:
    """Mean over runs, every question that ended without a score being 0."""
    each = [float(run["score"].sum()) / int(run["ended"].sum()) for run in runs if run["ended"].any()]
    return over_runs(each).mean


def _by_question(runs: list[pd.DataFrame]) -> pd.DataFrame:
    """Each question's mean over the runs that scored it."""
    index = pd.Index(dict.fromkeys(name for run in runs for name in run.index))
    scores = mean_by_question(np.array([run["score"].reindex(index).to_numpy("float64") for run in runs]))
    scenes = pd.concat([run["scene"] for run in runs])
    return pd.DataFrame({"score": scores, "scene": scenes[~scenes.index.duplicated()].reindex(index)}, index)


def cell_rows(table: Table, cells: list[Cell]) -> Iterator[dict[str, object]]:
    """Yield the cells as plain rows, for CSV."""
    for cell in cells:
        row, column = table.config.rows[cell.row], table.config.columns[cell.column]
        yield {
            "table": table.config.name,
            "row": row.label,
            "part": column.part or "",
            "column": column.label,
            "metric": column.metric if column.value == "mean" else f"{column.value} of {column.metric}",
            "ours": cell.value,
            "paper": cell.reference,
            "if_zero": cell.zero,
            "std": cell.std,
            "low": cell.low,
            "high": cell.high,
            "scored": cell.scored,
            "questions": cell.questions,
            "pending": cell.pending,
            "scenes": cell.scenes,
            "runs": cell.runs,
        }
