"""The runs of a table, one after another. What is done already is not done again, so a stopped table goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import yaml

from jobs.runs.progress import Progress, Silent
from jobs.runs.submit import RunResult, submit
from jobs.tables.table_file import Table, TableRun, load_table
from jobs.yaml_file import read_yaml
from schemas.errors import InputError
from schemas.run_folder import RunFolder
from schemas.storage import exists, join, write_bytes_atomic
from workers.method_steps import METHOD_STEPS
from workers.steps import Steps

TABLES = "tables"
"""Folder, in the output folder, of what was asked of each table when it was last run."""


@dataclass(frozen=True, slots=True)
class TableResult:
    """How a session of work on a table ended."""

    done: tuple[RunResult, ...]
    """Runs looked at, in order; the last may be incomplete."""
    wanted: int
    """Runs that were to be done."""

    @property
    def complete(self) -> bool:
        """Whether every run that was wanted is."""
        return len(self.done) == self.wanted and all(result.driven.complete for result in self.done)


def run_table(
    table: Table,
    rows: tuple[str, ...] = (),
    *,
    steps: Steps = METHOD_STEPS,
    progress: Callable[[], Progress] = Silent,
) -> TableResult:
    """Do the runs of a table that are not complete. All jobs are checked before the first begins.

    Args:
        table: The table.
        rows: Names of rows to do; empty for all.
        steps: The method; tests put fakes here.
        progress: Makes for each run who is told how it goes.

    Raises:
        InputError: A row is unknown, a job is wrong, or a run's folder holds another job.
        StopError: Another driver is at work on a run, or no further question can succeed.
    """
    jobs = list({job.output: (run, job) for run, job in ((run, table.job(run)) for run in table.runs(rows))}.values())
    _remember(table)
    done: list[RunResult] = []
    for number, (run, job) in enumerate(jobs, 1):
        told = progress()
        told.say(f"{number} of {len(jobs)}: {_described(table, run)} in {job.output}")
        try:
            done.append(submit(job, subject=f"{table.subject} row {run}", steps=steps, progress=told))
        except InputError as error:
            if RunFolder(job.output).exists():
                error.add_note(f"of a table: remove {job.output}, or name another folder with --output")
            raise
        if not done[-1].driven.complete:
            break
    return TableResult(tuple(done), len(jobs))


def as_last_run(table: Table) -> Table:
    """Return the table with what was asked of its base when it was last run into this folder, if it ever was."""
    place = _memory(table)
    return load_table(table.subject, output=table.output, settings=read_yaml(place)) if exists(place) else table


def _remember(table: Table) -> None:
    write_bytes_atomic(_memory(table), yaml.safe_dump(dict(table.settings)).encode())


def _memory(table: Table) -> str:
    return join(table.output, TABLES, f"{table.config.name}.yaml")


def _described(table: Table, run: TableRun) -> str:
    part = f", {run.part}" if run.part else ""
    repeat = f", repetition {run.repeat + 1}" if table.config.rows[run.row].repeats > 1 else ""
    return f"{table.config.rows[run.row].label}{part}{repeat}"
