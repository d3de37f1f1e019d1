"""A table file: rows that are runs of one base job with changes, columns that are metrics, and the paper's figures.

Every row is a job of its own that differs from the base in what `change` says; a row may also show another arm of
another row's run. `parts` multiply the runs, one for each data set or model, and columns say which part they show.

Run folders are named by a hash of what the job answers and how, so rows that are the same job share one run, in
whatever tables they are: the paper's base stands in eight.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from jobs.config import JobConfig, anchored_paths, checked_job, input_error
from jobs.runs.plan import content_id
from jobs.runs.submit import DATA
from jobs.scoring.cost_rows import COST_METRICS
from jobs.scoring.scores import COUNTED, IOU_METRIC, MATCHED
from jobs.yaml_file import read_yaml
from pipeline.models.config import STAGES
from schemas import storage
from schemas.errors import InputError

_PACKED = Path(__file__).resolve().parent / "presets"
PRESETS = _PACKED if _PACKED.is_dir() else _PACKED.parents[2] / "examples" / "tables"
"""Where a table is looked for that is given by its name alone."""

RUNS = "runs"
"""Folder of all runs, in the output folder."""

ID_LENGTH = 12
"""Hex digits of a run's folder: few enough to read out, enough for any number of rows."""

LAST = "last"
"""The last arm a run has: verified of the method, the only one of a baseline."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
_METRICS = {"llm_match", *IOU_METRIC.values(), *MATCHED, *COUNTED, *COST_METRICS}
_WITH_NUMBER = re.compile(r"acc@\d+(\.\d+)?")
_WITH_STAGES = re.compile(r"seconds@[a-z_]+(\+[a-z_]+)*")
_KIND = "kind"


class Column(BaseModel):
    """What stands in a column."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    label: str = Field(min_length=1, description="header")
    metric: str = Field(
        description="llm_match, miou, instance_miou, acc@K, f1@25, f1@50, zero_target, count_exact, count_error, "
        "count_bias, frames; or by run: calls, tokens, seconds, seconds@STAGE+STAGE"
    )
    value: Literal["mean", "p"] = Field(
        "mean", description="mean: with its interval; p: of the paired t test against row `against`"
    )
    against: str | None = Field(None, description="row that p compares with")
    of: str | None = Field(None, description="row whose run is shown, whatever the row; null for the row's own")
    part: str | None = Field(None, description="part whose run is shown; null where the table has none")
    category: str | None = Field(None, description="question type to keep; null keeps all")
    digits: int = Field(1, ge=0, le=6, description="digits after the point")

    @field_validator("metric")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in _METRICS and not _WITH_NUMBER.fullmatch(value) and not _WITH_STAGES.fullmatch(value):
            raise ValueError(f"one of {', '.join(sorted(_METRICS))}, acc@K, seconds@STAGE")
        return value


class Row(BaseModel):
    """A line of the table, and the run behind it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    label: str = Field(min_length=1, description="what the paper calls it")
    change: dict[str, Any] | None = Field(
        None,
        description="fields of the job that differ from the base, nested or dotted; {} for the base itself; null for a "
        "row without a run of its own",
    )
    run: str | None = Field(None, description="row whose run this row shares, another arm of it")
    arm: str = Field(LAST, description="initial, final, verified; last: the last that the run has")
    repeats: int = Field(1, ge=1, le=100, description="independent runs; above 1 the cell shows mean and deviation")
    hidden: bool = Field(False, description="run, and shown only where a column names it")
    reference: dict[str, int | float | str] = Field(default_factory=dict, description="the paper's figures by column")

    @model_validator(mode="after")
    def _one_source(self) -> Row:
        if self.change is not None and self.run is not None:
            raise ValueError("give change or run, not both")
        return self


class TableConfig(BaseModel):
    """A table of the paper as runs."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(description="name of the table")
    caption: str = Field("", description="what it shows, and which table of the paper")
    base: dict[str, Any] = Field(description="a job, as in a job file; its name and output are the table's")
    parts: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="changes of the base by data set or model; each row runs once for each"
    )
    columns: dict[str, Column] = Field(min_length=1, description="by a short name")
    rows: dict[str, Row] = Field(min_length=1, description="by a short name")

    @model_validator(mode="after")
    def _names_fit(self) -> TableConfig:
        for name in (self.name, *self.rows, *self.parts):
            if not _NAME.fullmatch(name):
                raise ValueError(f"{name!r} must be of letters, digits, - and _")
        for name, row in self.rows.items():
            if row.run is not None and (row.run not in self.rows or self.rows[row.run].change is None):
                raise ValueError(f"rows.{name}.run: {row.run!r} is no row with a change")
            for column in row.reference:
                if column not in self.columns:
                    raise ValueError(f"rows.{name}.reference: {column!r} is no column")
        for name, shown in self.columns.items():
            for field, row_name in (("of", shown.of), ("against", shown.against)):
                if row_name is not None and row_name not in self.rows:
                    raise ValueError(f"columns.{name}.{field}: {row_name!r} is no row")
            if (shown.value == "p") != (shown.against is not None):
                raise ValueError(f"columns.{name}: value p and against go together")
            if (shown.part is None) == bool(self.parts) or not {shown.part} - {None} <= set(self.parts):
                raise ValueError(
                    f"columns.{name}.part: one of the parts, {', '.join(self.parts) or 'of which are none'}"
                )
        return self


@dataclass(frozen=True, slots=True)
class TableRun:
    """One run of a table."""

    row: str
    """Row it was made for."""
    part: str | None
    """Part."""
    repeat: int
    """From 0."""

    def __str__(self) -> str:
        names = [self.row, *([self.part] if self.part else []), *([str(self.repeat)] if self.repeat else [])]
        return ".".join(names)


@dataclass(frozen=True, slots=True)
class Table:
    """A table file with its paths made absolute, and where its runs lie."""

    config: TableConfig
    """What the file says."""
    subject: str
    """The file, for messages."""
    output: str
    """Folder of tables: runs, stored replies and visibility of all of them lie there."""
    settings: Mapping[str, Any]
    """What was asked of the base beside the file, such as other scenes."""

    def source(self, row: str) -> str | None:
        """Return the row whose runs a row shows; None for one that only has the paper's figures."""
        found = self.config.rows[row]
        return row if found.change is not None else found.run

    def runs_of(self, row: str, part: str | None = None) -> tuple[TableRun, ...]:
        """Return the runs that a row shows, those of one part or of all."""
        source = self.source(row)
        if source is None:
            return ()
        parts = (part,) if part else tuple(self.config.parts) or (None,)
        return tuple(TableRun(source, name, n) for name in parts for n in range(self.config.rows[source].repeats))

    def runs(self, rows: tuple[str, ...] = ()) -> Iterator[TableRun]:
        """Yield every run that some rows need, or all, each once.

        Raises:
            InputError: A row is unknown.
        """
        for row in rows:
            if row not in self.config.rows:
                raise InputError("--rows", expected=f"some of {', '.join(self.config.rows)}", found=row)
        yield from dict.fromkeys(run for row in rows or self.config.rows for run in self.runs_of(row))

    def place(self, run: TableRun) -> str:
        """Return a run's folder.

        Raises:
            InputError: As `job`.
        """
        return self.job(run).output

    def job(self, run: TableRun) -> JobConfig:
        """Return the job of a run: stored replies and visibility are shared by all tables of the output folder.

        Raises:
            InputError: The base with its changes is no job.
        """
        change = self.config.rows[run.row].change
        assert change is not None
        job = merged(merged(self.config.base, self.config.parts[run.part] if run.part else {}), change)
        if run.repeat:
            job = _repeated(job, run.repeat)
        shared = {name: job.get(name) or storage.join(self.output, name) for name in ("calls", "visibility")}
        names = {"name": self.config.rows[run.row].label, "output": self.output}
        config = checked_job({**job, **shared, **names}, f"{self.subject} row {run}")
        place = storage.join(self.output, RUNS, content_id([_answered(config), run.repeat])[:ID_LENGTH])
        return config.model_copy(update={"output": place})


def load_table(path: str | Path, *, output: str | None = None, settings: Mapping[str, Any] | None = None) -> Table:
    """Return the table that a YAML file describes.

    Args:
        path: File, or the name of one of `PRESETS`.
        output: Folder of tables; None for `base.output`.
        settings: Fields of the base to change, nested or dotted, their paths absolute.

    Raises:
        InputError: The file is missing or wrong, or no folder is named.
    """
    file = find_table(path)
    found = read_yaml(file)
    # A preset of an installed package takes paths as if it lay in the working folder, as in a clone.
    folder = Path.cwd() / "examples" / "tables" if file.parent == _PACKED else file.resolve().parent
    for section in ("base", "parts", "rows"):
        found[section] = _anchored(found.get(section), section, folder)
    if isinstance(found["base"], dict):
        found["base"] = merged(found["base"], settings or {})
    try:
        config = TableConfig.model_validate({name: value for name, value in found.items() if value is not None})
    except ValidationError as error:
        raise input_error(file, error.errors()[0], TableConfig) from None
    where = output or config.base.get("output")
    if not where:
        raise InputError(file, field="base.output", expected="a folder, here or with --output", found="none")
    local = storage.local_path(str(where))
    place = str(where) if local is None else str(local.expanduser().absolute())
    return Table(config, str(file), place, dict(settings or {}))


def find_table(path: str | Path) -> Path:
    """Return the file of a table given by path or, for the paper's, by name.

    Raises:
        InputError: It is neither.
    """
    for file in (Path(path), PRESETS / f"{path}.yaml"):
        if file.is_file():
            return file
    names = ", ".join(sorted(preset.stem for preset in PRESETS.glob("*.yaml")))
    raise InputError("table", expected=f"a file, or one of {names}", found=str(path))


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Return a job with some fields changed: mappings field by field, anything else whole.

    A method of another kind takes the place of the base's: their settings are not the same.

    Args:
        base: Nested fields.
        change: Nested fields; a key with points, such as judging.verify, is a path.
    """
    result = dict(base)
    for path, value in change.items():
        key, _, rest = path.partition(".")
        new = {rest: value} if rest else value
        old = result.get(key)
        if isinstance(new, Mapping):
            other = key == "method" and _KIND in new and new[_KIND] != (old or {}).get(_KIND, "splatreasoner")
            new = merged({} if other or not isinstance(old, Mapping) else old, new)
        result[key] = new
    return result


def _answered(config: JobConfig) -> dict[str, Any]:
    """Return what a job answers and how; what only makes it faster is left out."""
    found = config.model_dump(mode="json", include={*DATA, "method"})
    models = {stage: config.models.endpoints[config.models.endpoint_of(stage)].identity() for stage in STAGES}
    asked = {"asks": config.models.max_asks, "prompts": str(config.models.prompts), "chunk": config.workers.chunk}
    return {**found, "models": models, **asked}


def _repeated(job: Mapping[str, Any], repeat: int) -> dict[str, Any]:
    """Give every endpoint the number of the repetition; the symbolic model answers the same every time."""
    models = dict(job.get("models") or {})
    endpoints = models.get("endpoints") or {}
    models["endpoints"] = {name: {**endpoint, "repeat": repeat} for name, endpoint in endpoints.items()}
    return {**job, "models": models}


def _anchored(found: Any, section: str, folder: Path) -> Any:
    """Make the paths of a section absolute, wherever a job's fields lie in it."""
    if not isinstance(found, dict):
        return found
    if section == "base":
        return anchored_paths(found, folder)
    if section == "parts":
        return {name: anchored_paths(part, folder) if isinstance(part, dict) else part for name, part in found.items()}
    return {
        name: {**row, "change": anchored_paths(row["change"], folder)}
        if isinstance(row, dict) and isinstance(row.get("change"), dict)
        else row
        for name, row in found.items()
    }
