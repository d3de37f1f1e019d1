"""The job file: what a run answers, with which method and models, and how wide it runs.

A job file is YAML. Paths in it are relative to the file itself, so a job runs the same from any folder.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from jobs.dataset_config import PATHS, DatasetConfig
from jobs.yaml_file import read_yaml
from pipeline.baselines.config import AnyMethod
from pipeline.config import MethodConfig
from pipeline.models.budget import BudgetConfig
from pipeline.models.config import ModelConfig
from schemas import storage
from schemas.errors import InputError
from schemas.questions import TASKS, Task

DEFAULT_METHOD = "splatreasoner"
"""Kind of a method whose fields name none."""

IN_SCENE = "scene"
"""Value of `questions` that takes each scene's own file."""


class WorkersConfig(BaseModel):
    """How wide a run goes. Nothing here changes an answer."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cpus: int | None = Field(
        None, ge=1, description="CPU slots of the local Ray; null takes every core of this machine"
    )
    address: str = Field("", description='an existing Ray cluster, such as "auto"; empty starts a local one')
    in_process: bool = Field(False, description="run in this process, without Ray: slower, easy to debug")
    model_actors: int = Field(
        2, ge=1, le=256, description="processes that ask the models; the symbolic model computes in them"
    )
    questions_in_flight: int | None = Field(
        None, ge=1, le=4096, description="questions begun and not ended; null takes four batches for each CPU slot"
    )
    batch: int | None = Field(
        None,
        ge=1,
        le=1000,
        description="questions of a unit that travel together; null adapts it to half a second of work",
    )
    memory_mb: int | None = Field(
        None,
        ge=1,
        description="megabytes that questions in flight may hold between their steps, candidate views above all; null "
        "takes a quarter of Ray's object store",
    )
    chunk: int = Field(25, ge=1, le=10_000, description="questions a unit of work; a unit is committed as a whole")
    timeout_s: float = Field(1800.0, gt=0, description="seconds one try of a question may take, waiting included")
    retries: int = Field(2, ge=0, le=20, description="further tries of a question after an error that may pass")
    oom_tries: int = Field(
        2,
        ge=1,
        le=20,
        description="tries after which a question fails, each having ended its worker since memory ran out",
    )


class JobConfig(BaseModel):
    """A run: scenes, questions, method, models and workers."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(min_length=1, max_length=200, description="name of the run, shown in reports")
    output: str = Field(min_length=1, description="run folder, a path or URI; made where it does not exist")
    scenes: tuple[str, ...] = Field(
        (), description="scene folders as paths, URIs or patterns such as scenes/*; one or a list; none with a dataset"
    )
    questions: str = Field(
        IN_SCENE,
        min_length=1,
        description='a question file, or "scene" for the questions.jsonl in each scene folder',
    )
    dataset: DatasetConfig | None = Field(
        None,
        validate_default=True,
        description="a benchmark in its official files, in place of scenes and questions",
    )
    tasks: tuple[Task, ...] = Field(TASKS, min_length=1, description="tasks to keep: eqa, ground_one, ground_many")
    limit: int | None = Field(None, ge=1, description="first questions of each scene to keep; null keeps all")
    other_scenes: Literal["refuse", "skip"] = Field(
        "refuse", description="what to do with questions about scenes that are not listed"
    )
    calls: str | None = Field(
        None, description="folder of stored model replies, local; runs may share one; null takes calls/ in the run"
    )
    visibility: str | None = Field(
        None,
        description="folder of the visibility index, a path or URI; runs may share one; null takes visibility/ in the "
        "run",
    )
    cache: Literal["on", "off", "replay"] = Field(
        "on",
        description="stored model replies: on: used and kept; off: neither; replay: nothing else is used, no call is "
        "sent, and a question whose reply is not stored fails",
    )
    budget: BudgetConfig = Field(
        default_factory=BudgetConfig,
        description="hard caps on what the run may spend; at a cap it ends and can be resumed with a higher one",
    )
    images: bool = Field(True, description="keep a thumbnail of every view that was considered, for the report")
    method: AnyMethod = Field(
        default_factory=MethodConfig, description="the method, by its kind, and its settings; the paper's by default"
    )
    models: ModelConfig = Field(default_factory=ModelConfig, description="the models and which stage asks which")
    workers: WorkersConfig = Field(default_factory=WorkersConfig, description="how wide the run goes")

    @field_validator("method", mode="before")
    @classmethod
    def _papers_method_needs_no_kind(cls, value: Any) -> Any:
        return {"kind": DEFAULT_METHOD, **value} if isinstance(value, dict) else value

    @field_validator("scenes", mode="before")
    @classmethod
    def _one_is_a_list(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @field_validator("dataset")
    @classmethod
    def _one_source_of_questions(cls, value: DatasetConfig | None, info: ValidationInfo) -> DatasetConfig | None:
        scenes, questions = info.data.get("scenes"), info.data.get("questions", IN_SCENE)
        if value is None and scenes == ():
            raise ValueError("scenes or a dataset to be given")
        if value is not None and (scenes or questions != IN_SCENE):
            raise ValueError("no scenes and questions beside a dataset, which brings its own")
        return value

    @model_validator(mode="after")
    def _calls_are_local(self) -> JobConfig:
        if storage.local_path(self.calls_folder()) is None:
            raise ValueError("calls: expected a local folder, since the output is not local")
        return self

    @model_validator(mode="after")
    def _money_has_prices(self) -> JobConfig:
        free = [name for name in self.models.remote_endpoints() if self.models.endpoints[name].price is None]
        if self.budget.usd is not None and free:
            price = f"models.endpoints.{free[0]}.usd_per_million_prompt"
            raise ValueError(f"{price}: expected a price, and one of replies, since budget.usd is a cap")
        return self

    def calls_folder(self) -> str:
        """Return the folder of stored model replies."""
        return self.calls if self.calls is not None else storage.join(self.output, "calls")

    def visibility_folder(self) -> str:
        """Return the folder of the visibility index."""
        return self.visibility if self.visibility is not None else storage.join(self.output, "visibility")


def load_job(path: str | Path) -> JobConfig:
    """Return the job a YAML file describes, its paths made absolute.

    Raises:
        InputError: The file is missing, is not YAML or has a wrong field. When several are wrong the first is the
            message and the others are its notes.
    """
    return checked_job(anchored_paths(read_yaml(path), Path(path).resolve().parent), path)


def anchored_paths(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return fields of a job file with their paths made absolute.

    Args:
        job: Parsed YAML, of a whole job or of some of its fields.
        folder: What relative paths are relative to.
    """
    found = dict(job)
    for field in ("output", "questions", "scenes", "calls", "visibility"):
        if field in found and not (field == "questions" and found[field] == IN_SCENE):
            found[field] = _anchored(found[field], folder)
    dataset = found.get("dataset")
    if isinstance(dataset, dict):
        paths = {name: _anchored(dataset[name], folder) for name in PATHS if name in dataset}
        found["dataset"] = {**dataset, **paths}
    models = found.get("models")
    if isinstance(models, dict) and "prompts" in models:
        found["models"] = {**models, "prompts": _anchored(models["prompts"], folder)}
    method = found.get("method")
    if isinstance(method, dict):
        files = {name: _anchored(method[name], folder) for name in ("file", "texts") if name in method}
        found["method"] = {**method, **files}
    return found


def checked_job(found: Any, subject: object) -> JobConfig:
    """Return the job in plain data, such as parsed YAML or a run's run.json.

    Raises:
        InputError: As `load_job`.
    """
    try:
        return JobConfig.model_validate(found)
    except ValidationError as error:
        first, *others = [input_error(subject, detail) for detail in error.errors()]
        for other in others:
            first.add_note(str(other))
        raise first from None


def _anchored(value: Any, folder: Path) -> Any:
    if isinstance(value, list):
        return [_anchored(item, folder) for item in value]
    if not isinstance(value, str) or not value or storage.local_path(value) is None:
        return value
    return os.path.normpath(folder / Path(value).expanduser())


def input_error(subject: object, detail: Any, root: type[BaseModel] = JobConfig) -> InputError:
    """Turn one of pydantic's findings about `root` into a line that names file, field, expected and found."""
    place, kind = _place(root, detail["loc"]), detail["type"]
    if kind == "union_tag_invalid":
        tags = detail["ctx"]["expected_tags"].replace("'", "")
        return InputError(
            subject, field=".".join([*place, "kind"]), expected=f"one of {tags}", found=detail["ctx"]["tag"]
        )
    if kind == "extra_forbidden":
        known = _fields_at(root, detail["loc"][:-1])
        expected = f"one of {', '.join(known)}" if known else "a known field"
        meant = get_close_matches(place[-1], known, 1)
        found = place[-1] + (f"; {meant[0]} is meant?" if meant else "")
        return InputError(subject, field=".".join(place[:-1]) or "top level", expected=expected, found=found)
    expected, value = detail["msg"].removeprefix("Input should be ").removeprefix("Value error, "), detail["input"]
    field, stated, one = expected.partition(": expected ")
    if kind == "value_error" and stated and isinstance(value, Mapping):
        # A model's fields do not fit each other; its validator names the one to mend.
        place, expected, value = [*place, field], one, _value_at(value, field)
    found = repr(value)
    if kind == "missing":
        expected, found = f"a value{_meaning(root, detail['loc'])}", "nothing"
    elif one and value is None:
        found = "nothing"
    elif place[-1:] == ["key_env"] or (place[-1:] == ["base_url"] and "@" in found):
        found = "another text, not shown since it may hold a key"
    return InputError(
        subject, field=".".join(place), expected=expected, found=found if len(found) <= 80 else found[:77] + "..."
    )


def _value_at(found: Any, place: str) -> Any:
    """Return the value at a dotted place in plain data; None where there is none."""
    for name in place.split("."):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def _place(root: type[BaseModel], place: tuple[Any, ...]) -> list[str]:
    """Return the fields on the way to a place, without the kinds that pydantic puts after a method's field."""
    return [str(part) for number, part in enumerate(place) if part not in _members(_model_at(root, place[:number]))]


def _meaning(root: type[BaseModel], place: tuple[Any, ...]) -> str:
    """Return what the field at a place means, up to the first comma, in brackets."""
    found = _model_at(root, place[:-1])
    known = isinstance(found, type) and issubclass(found, BaseModel) and str(place[-1]) in found.model_fields
    described = found.model_fields[str(place[-1])].description if known else None
    return f" ({re.split('[,;:] ', described)[0]})" if described else ""


def _fields_at(root: type[BaseModel], place: tuple[Any, ...]) -> list[str]:
    """Return the fields of the model at a place in another; none where the place is inside a list or a map."""
    found = _model_at(root, place)
    return list(found.model_fields) if isinstance(found, type) and issubclass(found, BaseModel) else []


def _model_at(found: Any, place: tuple[Any, ...]) -> Any:
    """Return the annotation at a place: a model, a union of methods, or None."""
    for part in place:
        if get_origin(found) is dict:
            found = get_args(found)[1]
        elif members := _members(found):
            found = members.get(part)
        elif isinstance(found, type) and issubclass(found, BaseModel) and str(part) in found.model_fields:
            found = found.model_fields[str(part)].annotation
        else:
            return None
    return found


def _members(annotation: Any) -> dict[str, type[BaseModel]]:
    """Return the models of a union by their kind; none of anything else."""
    models = [one for one in get_args(annotation) if isinstance(one, type) and issubclass(one, BaseModel)]
    return {one.model_fields["kind"].default: one for one in models if "kind" in one.model_fields}
