"""From a job to its units of work: scene x method x chunk of questions, each with an id made of its content."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from jobs.config import JobConfig
from jobs.dataset import Dataset, PlannedScene, file_sha256, load_dataset
from jobs.runs.problems import Problems
from jobs.runs.versions import STAGES
from pipeline.baselines.config import AnyMethod, files_of
from pipeline.baselines.scene_needs import check_scene, tasks_of
from pipeline.models.clients import make_clients
from pipeline.models.config import STAGES as MODEL_STAGES
from pipeline.models.config import ModelConfig
from pipeline.models.prompts import Prompts
from pipeline.scene.scene_file import find_parts
from schemas.errors import InputError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from schemas.tables import TABLES

ID_LENGTH = 32
"""Hex digits of a unit id: 128 bits, no collision at any number of units."""


_QUESTION_FIELDS = tuple(field.name for field in dataclasses.fields(Question))


@dataclass(frozen=True, slots=True)
class Basis:
    """What, beside a unit's scene and questions, its answers depend on."""

    method: Mapping[str, Any]
    """Resolved method config."""
    models: Mapping[str, Any]
    """By stage, what each model's answers depend on: endpoint, model, parameters."""
    asks: int
    """Times a stage is asked before a reply counts as unreadable."""
    prompts: Mapping[str, str]
    """Hash of each prompt."""
    stages: Mapping[str, int]
    """Version of each stage's code."""
    tables: Mapping[str, int]
    """Version of each table, see `TableSpec.work`."""


def basis_of(config: JobConfig) -> Basis:
    """Return what a job's answers depend on beside its data.

    Raises:
        InputError: A prompt is wrong, or a model's key is not set.
    """
    return Basis(
        method=config.method.model_dump(mode="json"),
        models=_identities(config.models, offline=config.cache == "replay"),
        asks=config.models.max_asks,
        prompts=Prompts.load(config.models.prompts).hashes(),
        stages=STAGES,
        tables={name: spec.work_version for name, spec in TABLES.items()},
    )


def plan_units(
    config: JobConfig, subject: object = "job", warn: Callable[[str], None] = lambda text: None
) -> Iterator[PlannedUnit]:
    """Return the units of a job, scene by scene; one scene is in memory at a time.

    All data are checked before the first unit, so what is wrong shows before anything is written.

    Args:
        config: The job.
        subject: What messages call it, such as its file.
        warn: Told what is odd and no reason to refuse.

    Raises:
        InputError: See `load_dataset`, `basis_of` and `check_scene`; or the output is one of the scenes. Nothing has
            run by then.
    """
    dataset, basis = load_dataset(config, subject, warn), dataclasses.asdict(basis_of(config))
    if config.output in dataset.uris.values():
        raise InputError(subject, field="output", expected="a folder of its own", found=f"the scene {config.output}")
    _check_scenes(config.method, dataset)
    parts = ((scene, part) for scene in dataset.scenes() for part in _chunks(scene.questions, config.workers.chunk))
    files = _Files(config.method)
    return (_unit(index, scene, part, files, basis) for index, (scene, part) in enumerate(parts))


def _check_scenes(method: AnyMethod, dataset: Dataset) -> None:
    """Refuse scenes that lack what the method reads, all at once."""
    problems, tasks = Problems(), tasks_of(method)
    for name, uri in dataset.uris.items():
        if dataset.index.has(name, tasks):
            try:
                check_scene(method, uri, find_parts(uri))
            except InputError as error:
                problems.add(error)
    problems.refuse()


class _Files:
    """Hashes of the files beside the scenes that a method reads, each taken once."""

    def __init__(self, method: AnyMethod) -> None:
        self.method, self._hashes = method, dict[str, str]()

    def sha256(self, scene: str, questions: tuple[Question, ...]) -> list[str]:
        """Return those of a unit.

        Raises:
            InputError: One is missing.
        """
        uris = {uri for question in questions for uri in files_of(self.method, scene, question.question_id)}
        for uri in uris - set(self._hashes):
            self._hashes[uri] = file_sha256(uri)
        return [self._hashes[uri] for uri in sorted(uris)]


def _chunks(questions: tuple[Question, ...], size: int) -> Iterator[tuple[Question, ...]]:
    for start in range(0, len(questions), size):
        yield questions[start : start + size]


def _unit(
    index: int, scene: PlannedScene, questions: tuple[Question, ...], files: _Files, basis: dict[str, Any]
) -> PlannedUnit:
    method, read = files.method.kind, files.sha256(scene.name, questions)
    content = {
        "scene": scene.sha256,
        "name": scene.name,
        "questions": [{name: getattr(question, name) for name in _QUESTION_FIELDS} for question in questions],
        "basis": basis,
        "as": method,
        **({"files": read} if read else {}),
    }
    unit_id = content_id(content)[:ID_LENGTH]
    return PlannedUnit(unit_id, index, scene.name, scene.uri, scene.sha256, method, questions)


def content_id(content: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _identities(models: ModelConfig, *, offline: bool) -> dict[str, Any]:
    clients = make_clients(models, offline=offline)
    return {stage: dict(clients[stage].identity()) for stage in MODEL_STAGES}
