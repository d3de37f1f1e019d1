"""The build job: which captures become scenes, how, and how wide the run goes. YAML, paths relative to the file."""

from __future__ import annotations

import glob
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from jobs.config import input_error
from jobs.yaml_file import read_yaml
from pipeline.construct.build_config import BuildConfig
from pipeline.construct.semantics.labels_2d.choose import MAIN
from pipeline.scene.captures.open_capture import CaptureKind
from schemas import storage

PATHS = ("output", "captures", "scenes", "questions", "working")
"""Fields that are relative to the job file."""


class CaptureEntry(BaseModel):
    """A capture, or several by a pattern."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    path: str = Field(min_length=1, description="folder or file, a path or a pattern such as scans/*")
    kind: CaptureKind = Field("auto", description="its format (docs/datasets.md); auto finds it")
    name: str = Field("", description="name of the scene; empty takes the capture's; for one capture only")


class BuildWorkers(BaseModel):
    """How wide a build run goes. Nothing here changes a scene, as long as it has no time budget."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cpus: int | None = Field(None, ge=1, description="CPU slots of the local Ray; null takes every core here")
    address: str = Field("", description='an existing Ray cluster, such as "auto"; empty starts a local one')
    in_process: bool | None = Field(
        None, description="build in this process, one capture at a time; null does so for a single capture"
    )
    threads: int | None = Field(
        None, ge=1, description="threads, and CPU slots, of a capture; null divides the slots among the captures"
    )
    timeout_s: float | None = Field(None, gt=0, description="seconds one try of a capture may take; null for any")
    retries: int = Field(1, ge=0, le=20, description="further tries of a capture after an error that may pass")
    oom_tries: int = Field(
        2, ge=1, le=20, description="tries after which a capture fails, each having ended its worker for want of memory"
    )


class BuildJob(BaseModel):
    """A run that builds scenes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(min_length=1, max_length=200, description="name of the run")
    output: str = Field(min_length=1, description="run folder, a path or URI; made where it does not exist")
    captures: tuple[CaptureEntry, ...] = Field(description="what is built: paths, patterns or entries")
    scenes: str | None = Field(
        None,
        description="folder in which each scene gets a folder of its name, a path or URI; null takes scenes/ in "
        "the run",
    )
    questions: str | None = Field(
        None, description="question file whose lines are copied into the scenes they name; captures have none"
    )
    working: str | None = Field(
        None,
        description="local folder of checkpoints, on a disk that every node sees, in which each run takes a folder of "
        "its own; null takes working/ in the run",
    )
    build: BuildConfig = Field(default_factory=BuildConfig, description="how a capture becomes a scene")
    workers: BuildWorkers = Field(default_factory=BuildWorkers, description="how wide the run goes")

    @field_validator("captures", mode="before")
    @classmethod
    def _paths_are_entries(cls, value: Any) -> Any:
        found = [value] if isinstance(value, str | dict) else value
        return [{"path": one} if isinstance(one, str) else one for one in found] if isinstance(found, list) else found

    @field_validator("captures")
    @classmethod
    def _some(cls, value: tuple[CaptureEntry, ...]) -> tuple[CaptureEntry, ...]:
        if not value:
            raise ValueError("at least one capture")
        return value

    @model_validator(mode="after")
    def _checkpoints_are_local(self) -> BuildJob:
        if storage.local_path(self.output if self.working is None else self.working) is None:
            raise ValueError("working must name a local folder when the output is not local")
        return self

    def scene_folder(self, name: str) -> str:
        """Return where a scene goes."""
        return storage.join(self.scenes if self.scenes is not None else storage.join(self.output, "scenes"), name)


def load_build_job(path: str | Path) -> BuildJob:
    """Return the build job a YAML file describes, its paths made absolute.

    Raises:
        InputError: The file is missing, is not YAML or has a wrong field; further ones are its notes.
    """
    return checked_build_job(anchored(read_yaml(path), Path(path).resolve().parent), path)


def anchored(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return fields of a build job with their paths made absolute.

    Args:
        job: Plain data.
        folder: What relative paths are relative to.
    """

    def at(value: Any) -> Any:
        if isinstance(value, list):
            return [at(one) for one in value]
        if isinstance(value, dict):
            return {**value, **({"path": at(value["path"])} if "path" in value else {})}
        if not isinstance(value, str) or not value or storage.local_path(value) is None:
            return value
        place = os.path.join(folder, os.path.expanduser(value))
        # In a pattern, "*/" asks for folders, and "*/sparse/.." for those that have one.
        return place if glob.has_magic(place) else os.path.normpath(place)

    found = {name: at(value) if name in PATHS else value for name, value in job.items()}
    source = ((found.get("build") or {}).get("semantics") or {}).get("source")
    if isinstance(source, dict):
        local = {name: at(one) for name, one in source.items() if name in MAIN.values() and _lies_in(folder, one)}
        semantics = {**found["build"]["semantics"], "source": {**source, **local}}
        found["build"] = {**found["build"], "semantics": semantics}
    return found


def _lies_in(folder: Path, value: Any) -> bool:
    """Return whether a value names what lies below a folder: a model may also be named as on a hub.

    Of a path with {scene} the part before it decides.
    """
    return isinstance(value, str) and value != "" and (folder / value.partition("{")[0]).exists()


def checked_build_job(found: Any, subject: object) -> BuildJob:
    """Return the build job in plain data, such as parsed YAML or a run's run.json.

    Raises:
        InputError: As `load_build_job`.
    """
    try:
        return BuildJob.model_validate(found)
    except ValidationError as error:
        first, *others = [input_error(subject, detail, BuildJob) for detail in error.errors()]
        for other in others:
            first.add_note(str(other))
        raise first from None
