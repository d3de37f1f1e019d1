"""Table `build_plan`: every capture of a build run. Written once, before any work, as the run's plan.parquet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from schemas.errors import InputError
from schemas.manifest_file import checked_id
from schemas.table import TableSpec


@dataclass(frozen=True, slots=True)
class PlannedCapture:
    """A unit of work: one capture to be built into a scene."""

    unit: str
    """Hash of the capture's files, its name, its questions and all that shapes the scene."""
    unit_index: int
    """Place in the plan, 0-based; final tables keep this order."""
    scene: str
    """Name of the scene, unique in the run."""
    capture: str
    """Path or URI of the capture."""
    kind: str
    """Format of the capture, or auto."""
    capture_sha256: str
    """What the capture's files were when it was planned."""
    scene_uri: str
    """Folder of the scene."""

    @property
    def id(self) -> str:
        """The unit's id."""
        return self.unit

    @property
    def items(self) -> tuple[PlannedCapture, ...]:
        """What is dispatched one by one: the capture."""
        return (self,)

    @property
    def item_names(self) -> tuple[str, ...]:
        """Names of its items, as rows carry them."""
        return (self.scene,)

    def rows(self) -> Iterator[PlannedCapture]:
        """Yield the unit's rows of the plan: itself."""
        yield self


BUILD_PLAN = TableSpec(
    name="build_plan",
    version=1,
    record=PlannedCapture,
    key=("unit",),
    columns={
        "unit": "string",
        "unit_index": "int64",
        "scene": "string",
        "capture": "string",
        "kind": "string",
        "capture_sha256": "string",
        "scene_uri": "string",
    },
)


def iter_captures(path: Path) -> Iterator[PlannedCapture]:
    """Yield the captures of a plan file in order.

    Raises:
        InputError: The file is not a plan of this version, or a unit's id could not be a file name.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            BUILD_PLAN.check(file.schema_arrow, path)
            captures = BUILD_PLAN.to_rows(file.read())
    except (pa.ArrowException, OSError) as error:
        raise InputError(path, expected="a readable plan", found=str(error).splitlines()[0]) from error
    for capture in captures:
        checked_id(capture.unit)
        yield capture
