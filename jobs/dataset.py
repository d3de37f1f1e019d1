"""The scenes and questions of a job, found and checked before anything runs, and then given scene by scene."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from jobs.config import IN_SCENE, JobConfig
from jobs.dataset_config import DatasetConfig
from jobs.question_index import QuestionIndex
from jobs.runs.problems import Problems
from pipeline.datasets import load_dataset_questions
from pipeline.datasets.missing import missing_scenes, scene_folders
from pipeline.scene.load import read_views
from pipeline.scene.scene_file import BUILD, OBJECTS, QUESTIONS, SceneParts, find_parts
from schemas import storage
from schemas.errors import InputError
from schemas.questions import Question

NO_CONTENT = frozenset({QUESTIONS, OBJECTS, BUILD})
"""Files of a scene folder that no stage reads: changing them does not change the scene."""

READERS = 8
"""Threads that hash files; hashing releases the interpreter lock."""


@dataclass(frozen=True, slots=True)
class PlannedScene:
    """A scene of a job."""

    name: str
    """Name, as questions and rows carry it."""
    uri: str
    """Path or URI of its folder."""
    sha256: str
    """Hash of its files."""
    questions: tuple[Question, ...]
    """Its questions, in file order."""


def find_scenes(patterns: Iterable[str], subject: object, problems: Problems) -> tuple[str, ...]:
    """Return the scene folders that paths, URIs and patterns name, patterns sorted.

    A pattern that names nothing and a folder named twice are problems.
    """
    found: dict[str, str] = {}
    for pattern in patterns:
        path = storage.local_path(pattern)
        if path is not None and glob.has_magic(str(path)):
            matches = sorted(m for m in glob.glob(str(path), recursive=True) if Path(m).is_dir())
            missing = "a pattern that matches folders", pattern
        else:
            matches = [pattern] if storage.exists(pattern) else []
            missing = "a scene folder", f"nothing at {pattern}"
        if not matches:
            problems.add(InputError(subject, field="scenes", expected=missing[0], found=missing[1]))
        for uri in matches:
            path = storage.local_path(uri)
            key = str(path.resolve()) if path is not None else uri.rstrip("/")
            if key in found:
                problems.add(InputError(subject, field="scenes", expected="each scene once", found=f"{uri} twice"))
            found.setdefault(key, uri)
    return tuple(found.values())


def scene_sha256(uri: str) -> str:
    """Return the hash of a scene's files, names and contents.

    Raises:
        InputError: There is no file, or one cannot be read.
    """
    path = storage.local_path(uri)
    single = path is not None and path.is_file()
    names = [""] if single else [n for n in storage.list_files(uri, recursive=True) if n not in NO_CONTENT]
    if not names:
        raise InputError(uri, expected="a scene folder with files", found="no file")
    with ThreadPoolExecutor(READERS) as pool:
        digests = list(pool.map(lambda name: file_sha256(storage.join(uri, name) if name else uri), names))
    whole = hashlib.sha256()
    for name, digest in zip(names, digests, strict=True):
        whole.update(f"{digest} {name}\n".encode())
    return whole.hexdigest()


def file_sha256(uri: str) -> str:
    """Return the SHA-256 of a file's content.

    Raises:
        InputError: It cannot be read.
        RetryError: A remote store failed to answer.
    """
    path = storage.local_path(uri)
    if path is None:
        return hashlib.sha256(storage.read_bytes(uri)).hexdigest()
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(uri, expected="a file that can be read", found=error.strerror) from error


def load_dataset(
    config: JobConfig, subject: object = "job", warn: Callable[[str], None] = lambda text: None
) -> Dataset:
    """Return a job's scenes and where their questions lie, after reading every question and camera file once.

    Args:
        config: The job.
        subject: What messages call it, such as its file.
        warn: Told what is odd and no reason to refuse: views whose pose cannot be used.

    Raises:
        InputError: A scene or question file is missing or wrong, a scene has no usable view, two scenes share a name,
            two questions share an id, a question is about a scene that is not listed, or no question is left. The
            first problem is the message and the others are its notes.
    """
    problems = Problems()
    if config.dataset is not None:
        uris, index = _official(config, config.dataset, problems, warn)
    else:
        uris, index = _listed(config, subject, problems, warn)
    index.find_repeated(problems)
    problems.refuse()
    if not index.kept:
        expected = f"a question of task {' or '.join(config.tasks)}"
        raise InputError(subject, field="questions", expected=expected, found="none")
    return Dataset(uris, index)


def _listed(
    config: JobConfig, subject: object, problems: Problems, warn: Callable[[str], None]
) -> tuple[dict[str, str], QuestionIndex]:
    """Return the scenes that a job lists by name, and their questions."""
    uris: dict[str, str] = {}
    files: list[str] = []
    for uri in find_scenes(config.scenes, subject, problems):
        try:
            parts = find_parts(uri)
            if parts.name in uris:
                found = f"{parts.name}, as {uris[parts.name]}"
                raise InputError(uri, field="name", expected="a name no other scene has", found=found)
            uris[parts.name] = uri
            files.append(storage.join(uri, QUESTIONS))
            _warn_of_views(parts, uri, warn)
        except InputError as error:
            # Some errors know the scene by its name only.
            problems.add(error if uri in error.subject else _of(uri, error))
    index = QuestionIndex(list(uris), config.tasks, config.limit, refuse_others=config.other_scenes == "refuse")
    for file in files if config.questions == IN_SCENE else [config.questions]:
        index.read(file, problems)
    return uris, index


def _official(
    config: JobConfig, dataset: DatasetConfig, problems: Problems, warn: Callable[[str], None]
) -> tuple[dict[str, str], QuestionIndex]:
    """Return the scenes below a dataset's roots that its questions ask about, and the questions."""
    questions = load_dataset_questions(
        dataset.kind,
        dataset.path,
        dataset.subset,
        subset_file=dataset.subset_file,
        labels=dataset.labels,
        objects=dataset.objects,
    )
    questions = tuple(question for question in questions if question.task in config.tasks)
    uris: dict[str, str] = {}
    skips = dataset.missing == "skip"
    absent = missing_scenes(questions, dataset.roots)
    for scene in absent:
        if skips:
            warn(f"left out: {scene}")
        else:
            source = f"{scene.dataset} ({scene.page})" if scene.page else scene.dataset
            found = f"nothing, for questions: {scene.questions}; {source}: {scene.how}"
            expected = f"a scene at {scene.looked_in[0]}"
            problems.add(InputError(dataset.path, field=f"scene {scene.scene}", expected=expected, found=found))
    lost = {scene.scene for scene in absent}
    for name in dict.fromkeys(question.scene for question in questions if question.scene not in lost):
        folders = [folder for folder in scene_folders(name, dataset.roots) if storage.exists(folder)]
        wrong: list[InputError] = []
        for folder in folders:
            try:
                _warn_of_views(find_parts(folder), folder, warn)
            except InputError as error:
                wrong.append(error if folder in error.subject else _of(folder, error))
            else:
                uris[name] = folder
                break
        if name not in uris and skips:
            warn(f"left out: {name}: {wrong[0]}")
        elif name not in uris:
            # A raw capture is no scene yet; the first folder is the one a person expects.
            problems.add(wrong[0])
    index = QuestionIndex(list(uris), config.tasks, config.limit, refuse_others=False)
    index.take(dataset.path, questions, problems)
    return uris, index


def _warn_of_views(parts: SceneParts, uri: str, warn: Callable[[str], None]) -> None:
    for line in read_views(parts).warnings:
        warn(f"{uri}: {line}")


def _of(uri: str, error: InputError) -> InputError:
    return InputError(uri, field=error.field, expected=error.expected, found=error.found)


@dataclass(frozen=True, slots=True)
class Dataset:
    """A job's scenes and questions, checked."""

    uris: Mapping[str, str]
    """Path or URI of each scene's folder, by name, in order."""
    index: QuestionIndex
    """Where the questions lie."""

    def scenes(self) -> Iterator[PlannedScene]:
        """Yield the scenes that have questions, in order, one in memory at a time.

        Raises:
            InputError: A file cannot be read, or has changed since it was checked.
        """
        for name, questions in self.index.by_scene():
            yield PlannedScene(name, self.uris[name], scene_sha256(self.uris[name]), questions)
