"""Table `plan`: every question of a run with the unit it belongs to. Written once, before any work; never changed.

The plan holds the questions themselves, so that a run can be resumed from its folder alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import re
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from schemas import storage
from schemas.errors import InputError
from schemas.parts import ROW_GROUP_ROWS, WRITER, write_stream
from schemas.questions import Question
from schemas.table import TableSpec

if TYPE_CHECKING:
    import pyarrow as pa

PLAN_FILE = "plan.parquet"

BATCH_ROWS = 4096
"""Rows that are records at a time, when a plan is written or read."""

_UNIT_ID = re.compile(r"[A-Za-z0-9_-]+")
"""Unit ids become file names."""


@dataclass(frozen=True, slots=True)
class PlanRow:
    """One question, planned."""

    unit: str
    """Unit id: hash of the scene's content, the questions, the method, the models, the prompts and the code."""
    unit_index: int
    """Place of the unit in the plan, 0-based; final tables keep this order."""
    position: int
    """Place of the question in its unit, 0-based."""
    scene_uri: str
    """Path or URI of the scene."""
    scene_sha256: str
    """Hash of the scene's files when it was planned."""
    method: str
    """Method that answers."""
    question_id: str
    """Question, unique in the run."""
    scene: str
    """Name of the scene."""
    task: str
    """eqa, ground_one or ground_many."""
    question: str
    """The query Q."""
    answer: str | None
    """Reference answer; null when unknown."""
    extra_answers: tuple[str, ...]
    """Other answers the reference accepts."""
    category: str
    """Question type, for grouping."""
    target_ids: tuple[int, ...] | None
    """Ground-truth instances; null when unknown."""
    target_category: str
    """Category of the target, for grouping."""


PLAN = TableSpec(
    name="plan",
    version=1,
    record=PlanRow,
    key=("question_id",),
    columns={
        "unit": "string",
        "unit_index": "int64",
        "position": "int32",
        "scene_uri": "string",
        "scene_sha256": "string",
        "method": "string",
        "question_id": "string",
        "scene": "string",
        "task": "string",
        "question": "string",
        "answer": "string?",
        "extra_answers": "list<string>",
        "category": "string",
        "target_ids": "list<int64>?",
        "target_category": "string",
    },
)

_QUESTION_FIELDS = tuple(field.name for field in dataclasses.fields(Question))


@dataclass(frozen=True, slots=True)
class PlannedUnit:
    """A unit of work: one scene, one method, a chunk of questions."""

    id: str
    """Content hash."""
    index: int
    """Place in the plan."""
    scene: str
    """Name of the scene."""
    scene_uri: str
    """Path or URI of the scene."""
    scene_sha256: str
    """Hash of the scene's files when it was planned."""
    method: str
    """Method that answers."""
    questions: tuple[Question, ...]
    """The chunk, in order."""

    @property
    def items(self) -> tuple[Question, ...]:
        """What is dispatched one by one: its questions."""
        return self.questions

    @property
    def item_names(self) -> tuple[str, ...]:
        """Ids of its items, as rows carry them."""
        return tuple(question.question_id for question in self.questions)

    def rows(self) -> Iterator[PlanRow]:
        """Yield the unit's rows of the plan."""
        for position, question in enumerate(self.questions):
            shared = (self.id, self.index, position, self.scene_uri, self.scene_sha256, self.method)
            yield PlanRow(*shared, **{name: getattr(question, name) for name in _QUESTION_FIELDS})


@dataclass(frozen=True, slots=True)
class WrittenPlan:
    """A plan that has been written."""

    sha256: str
    """Hash of the file."""
    units: int
    """Units in it."""
    questions: int
    """Questions in it."""


class Planned(Protocol):
    """A unit on its way into a plan."""

    def rows(self) -> Iterator[Any]:
        """Yield the unit's rows of the plan."""
        ...


def write_plan(uri: str, units: Iterable[Planned], spec: TableSpec[Any] = PLAN) -> WrittenPlan:
    """Write the plan, which appears whole or, when `units` ends in an error, not at all.

    One row group is in memory at a time, however many units there are.

    Args:
        uri: Path or URI of the file.
        units: The units in order.
        spec: Table of their rows.
    """
    path, counted = storage.local_path(uri), _Counted(units, spec)
    if path is not None:
        questions = write_stream(spec, counted.tables(), path)
        return WrittenPlan(_sha256(path), counted.units, questions)
    with tempfile.TemporaryDirectory(prefix="splatreasoner-") as place:
        aside = Path(place, PLAN_FILE)
        questions = write_stream(spec, counted.tables(), aside)
        storage.write_bytes_atomic(uri, aside.read_bytes())
        return WrittenPlan(_sha256(aside), counted.units, questions)


class _Counted:
    """Units on their way into a file, counted as they pass."""

    def __init__(self, units: Iterable[Planned], spec: TableSpec[Any]) -> None:
        self._source, self._spec = units, spec
        self.units = 0

    def tables(self) -> Iterator[pa.Table]:
        """Yield the rows, some thousands at a time."""
        waiting: list[Any] = []
        for unit in self._source:
            self.units += 1
            waiting.extend(unit.rows())
            if len(waiting) >= BATCH_ROWS:
                yield self._spec.to_arrow(waiting)
                waiting = []
        if waiting:
            yield self._spec.to_arrow(waiting)


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def encode_plan(units: Iterable[PlannedUnit]) -> bytes:
    """Return the plan as the bytes of one Parquet file."""
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    with pq.ParquetWriter(sink, PLAN.arrow_schema(), **WRITER) as writer:
        waiting: list[PlanRow] = []
        for unit in units:
            waiting.extend(unit.rows())
            if len(waiting) >= ROW_GROUP_ROWS:
                writer.write_table(PLAN.to_arrow(waiting), row_group_size=len(waiting))
                waiting = []
        if waiting:
            writer.write_table(PLAN.to_arrow(waiting), row_group_size=len(waiting))
    return sink.getvalue()


def iter_plan(path: Path) -> Iterator[PlannedUnit]:
    """Yield the units of a plan file in order, a batch of rows in memory at a time.

    Raises:
        InputError: The file is not a plan of this version, or a unit's id could not be a file name.
    """
    import pyarrow.parquet as pq

    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        PLAN.check(file.schema_arrow, path)
        waiting: list[PlanRow] = []
        for batch in file.iter_batches(batch_size=BATCH_ROWS):
            for row in PLAN.to_rows(batch):
                if not _UNIT_ID.fullmatch(row.unit):
                    raise InputError(path, field="unit", expected="letters, digits, - and _ only", found=repr(row.unit))
                if waiting and row.unit_index != waiting[0].unit_index:
                    yield _unit(waiting)
                    waiting = []
                waiting.append(row)
        if waiting:
            yield _unit(waiting)


def _unit(rows: list[PlanRow]) -> PlannedUnit:
    first = rows[0]
    questions = []
    for row in rows:
        values: dict[str, Any] = {name: getattr(row, name) for name in _QUESTION_FIELDS}
        questions.append(Question(**values))
    return PlannedUnit(
        id=first.unit,
        index=first.unit_index,
        scene=first.scene,
        scene_uri=first.scene_uri,
        scene_sha256=first.scene_sha256,
        method=first.method,
        questions=tuple(questions),
    )
