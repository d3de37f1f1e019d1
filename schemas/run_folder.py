"""A run's folder: where each thing lies in it, and how its tables are read back.

run.json        resolved configuration, versions, hash of the plan; written after the plan: with it the run exists
plan.parquet    every planned question
<table>/        parts, named by unit and content
manifests/      one JSON per committed unit, until its block is merged
blocks/         one JSON per block of units whose parts were merged
discarded/      one JSON per commit that does not count any more
driver/         one JSON per driver the run has had, counted
calls/          cache of model calls, and journals of what they cost
visibility/     rows of the visibility index, unless the job names another folder
images/         thumbnails of the views that were considered
results/        answers.parquet and arms.parquet, or builds.parquet, whole
working/        checkpoints and progress of captures being built
events.jsonl    what happened, a line each
report.html     written by `report`, with its data in report/
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schemas import storage
from schemas.build_plan import PlannedCapture, iter_captures
from schemas.builds import BUILDS
from schemas.calls import TIMINGS
from schemas.committed import Committed, PartReader
from schemas.errors import InputError
from schemas.manifest_file import Manifest, sealed
from schemas.plan import PLAN_FILE, PlannedUnit, iter_plan
from schemas.plan_columns import unit_sizes
from schemas.table import TableSpec
from schemas.tables import table_spec

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

RUN_FILE = "run.json"

BUILD_RUN = "build"
"""Value of `kind` in the run.json of a run that builds scenes; runs that answer questions have no such field."""

_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
"""Names that some systems keep for devices."""

LONGEST_NAME = 80
"""Longest escaped name; longer ones are cut and told apart by their hash. File systems stop at 255."""


def is_build_run(found: Mapping[str, Any]) -> bool:
    """Return whether a run.json is that of a run that builds scenes."""
    return found.get("kind") == BUILD_RUN


@dataclass(frozen=True, slots=True)
class RunFolder:
    """A run on disk or in an object store."""

    root: str
    """Path or URI."""

    def uri(self, *names: str) -> str:
        """Return the path or URI of something in the folder."""
        return storage.join(self.root, *names)

    def exists(self) -> bool:
        """Return whether the run has been planned and written."""
        return storage.exists(self.uri(RUN_FILE))

    def read_run(self) -> dict[str, Any]:
        """Return run.json.

        Raises:
            InputError: There is none, or it is not JSON.
        """
        uri = self.uri(RUN_FILE)
        if not storage.exists(uri):
            raise InputError(self.root, expected=f"a run folder with {RUN_FILE}", found="none")
        try:
            found = json.loads(storage.read_bytes(uri))
        except ValueError as error:
            raise InputError(uri, expected="JSON", found=str(error)) from error
        if not isinstance(found, dict):
            raise InputError(uri, expected="a JSON object", found=type(found).__name__)
        return found

    def builds(self) -> bool:
        """Return whether the run builds scenes, rather than answering questions.

        Raises:
            InputError: As `read_run`.
        """
        return is_build_run(self.read_run())

    def refuse_builds(self) -> None:
        """Refuse a run that builds scenes, where answers are wanted.

        Raises:
            InputError: It is one, or as `read_run`.
        """
        if self.builds():
            raise InputError(self.root, expected="a run that answers questions", found="one that builds scenes")

    def identity(self) -> str:
        """Return what tells this run from all others, wherever its folder is moved to."""
        found = self.read_run()
        known = found.get("id") or f"{found.get('created')} {found.get('plan')}"
        return hashlib.sha256(str(known).encode()).hexdigest()[:32]

    def write_run(self, content: Mapping[str, Any]) -> None:
        """Write run.json, with a hash of its content for `verify`."""
        storage.write_bytes_atomic(self.uri(RUN_FILE), sealed(content))

    def units(self) -> Iterator[PlannedUnit]:
        """Yield the planned units in order.

        Raises:
            InputError: There is no plan, or it is damaged.
        """
        import pyarrow as pa

        uri = self.uri(PLAN_FILE)
        if not storage.exists(uri):
            raise InputError(self.root, expected=f"a run folder with {PLAN_FILE}", found="none")
        with storage.local_copy(uri) as path:
            try:
                yield from iter_plan(path)
            except (pa.ArrowException, OSError) as error:
                raise InputError(uri, expected="a readable plan", found=str(error).splitlines()[0]) from error

    def captures(self) -> Iterator[PlannedCapture]:
        """Yield the planned captures of a build run in order.

        Raises:
            InputError: There is no plan, or it is damaged.
        """
        uri = self.uri(PLAN_FILE)
        if not storage.exists(uri):
            raise InputError(self.root, expected=f"a run folder with {PLAN_FILE}", found="none")
        with storage.local_copy(uri) as path:
            yield from iter_captures(path)

    def manifests(self) -> Iterator[Manifest]:
        """Yield the manifests of the committed units in plan order."""
        committed = Committed.load(self.root)
        for unit in unit_sizes(self.root):
            if unit in committed:
                yield committed.manifest(unit)

    def parts(self, table: str, columns: tuple[str, ...] | None = None) -> Iterator[pa.Table]:
        """Yield a table's verified rows unit by unit, in plan order, with all columns or some."""
        committed, reader = Committed.load(self.root), PartReader(self.root)
        for unit in unit_sizes(self.root):
            if unit in committed:
                yield committed.read(reader, unit, table, columns)


def read_table(run: str | Path, name: str, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Return a table of a run: committed rows only, in plan order and, within a question, in the order they arose.

    Args:
        run: Run folder.
        name: Table, such as "answers".
        columns: Columns wanted; None for all.

    Raises:
        InputError: No such run, table or column, or a part is damaged.
    """
    import pyarrow as pa

    spec, folder = table_spec(name), RunFolder(str(run))
    if folder.builds() != (name == BUILDS.name) and name != TIMINGS.name:
        holds = f"{BUILDS.name} and {TIMINGS.name}" if folder.builds() else f"all but {BUILDS.name}"
        raise InputError(run, field="table", expected=f"one of this run's: {holds}", found=name)
    unknown = [column for column in columns or () if column not in spec.columns]
    if unknown:
        raise InputError(run, field=f"table {name}", expected=f"one of {', '.join(spec.columns)}", found=unknown[0])
    wanted = None if columns is None else tuple(columns)
    empty = spec.conform(spec.arrow_schema().empty_table(), wanted)
    return to_frame(spec, pa.concat_tables([empty, *folder.parts(name, wanted)]))


def to_frame(spec: TableSpec[Any], table: pa.Table) -> pd.DataFrame:
    """Return rows of a table as pandas has them; a whole number that may be missing does not turn into a float."""
    import pandas as pd

    frame = table.to_pandas()
    nullable = {"int32?": pd.Int32Dtype(), "int64?": pd.Int64Dtype()}
    for column in frame.columns:
        dtype = nullable.get(spec.columns[column])
        if dtype is not None:
            frame[column] = pd.array(table.column(column).to_pylist(), dtype=dtype)
    return frame


def safe_name(text: str) -> str:
    """Return a file name for any text: ids that come from data never reach a path as they are.

    Letters, digits, dot, dash and underscore stay; where anything else was, or the text is long, starts with a dot or
    means a device to some systems, a hash of the whole text is added so that different texts keep different names.
    """
    kept = re.sub(r"[^A-Za-z0-9._-]", "_", text).lstrip(".")[:LONGEST_NAME]
    if kept and kept == text and not _DEVICE.fullmatch(text):
        return kept
    return f"{kept}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"


def image_name(scene: str, candidate: str, world_to_camera: Sequence[float]) -> str:
    """Return the path, below the run folder, of a candidate view's thumbnail.

    The pose is in the name, since a novel candidate's id counts the clusters of one question only.

    Args:
        scene: Scene name.
        candidate: Candidate id, as in `candidates`.
        world_to_camera: Its 12 numbers, as in `candidates`.
    """
    pose = ",".join(float(value).hex() for value in world_to_camera)
    tag = hashlib.sha256(f"{candidate}\n{pose}".encode()).hexdigest()[:10]
    return f"images/{safe_name(scene)}/{safe_name(candidate)}-{tag}.jpg"
