"""The scenes and questions of a job, found and checked before anything runs."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from jobs.config import IN_SCENE, JobConfig
from pipeline.scene.scene_file import OBJECTS, QUESTIONS, find_parts
from schemas import storage
from schemas.errors import InputError
from schemas.question_file import load_questions
from schemas.questions import Question

NO_CONTENT = frozenset({QUESTIONS, OBJECTS})
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


def find_scenes(patterns: Iterable[str], subject: object = "job") -> tuple[str, ...]:
    """Return the scene folders that paths, URIs and patterns name, patterns sorted.

    Raises:
        InputError: One names nothing, or a folder is named twice.
    """
    found: list[str] = []
    for pattern in patterns:
        path = storage.local_path(pattern)
        if path is not None and glob.has_magic(str(path)):
            matches = sorted(m for m in glob.glob(str(path), recursive=True) if Path(m).is_dir())
            if not matches:
                raise InputError(subject, field="scenes", expected="a pattern that matches folders", found=pattern)
            found.extend(matches)
        elif not storage.exists(pattern):
            raise InputError(subject, field="scenes", expected="a scene folder", found=f"nothing at {pattern}")
        else:
            found.append(pattern)
    same: dict[str, str] = {}
    for uri in found:
        path = storage.local_path(uri)
        key = str(path.resolve()) if path is not None else uri.rstrip("/")
        if key in same:
            raise InputError(subject, field="scenes", expected="each scene once", found=f"{uri} twice")
        same[key] = uri
    return tuple(found)


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
        digests = list(pool.map(lambda name: _file_sha256(storage.join(uri, name) if name else uri), names))
    whole = hashlib.sha256()
    for name, digest in zip(names, digests, strict=True):
        whole.update(f"{digest} {name}\n".encode())
    return whole.hexdigest()


def _file_sha256(uri: str) -> str:
    path = storage.local_path(uri)
    if path is None:
        return hashlib.sha256(storage.read_bytes(uri)).hexdigest()
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def load_dataset(config: JobConfig, subject: object = "job") -> tuple[PlannedScene, ...]:
    """Return a job's scenes in order, each with its questions; scenes without questions are left out.

    Raises:
        InputError: A scene or question file is missing or wrong, two scenes share a name, two questions share an
            id, a question is about a scene that is not listed, or no question is left.
    """
    uris: dict[str, str] = {}
    for uri in find_scenes(config.scenes, subject):
        name = find_parts(uri).name
        if name in uris:
            raise InputError(uri, field="name", expected="a name no other scene has", found=f"{name}, as {uris[name]}")
        uris[name] = uri
    asked: dict[str, list[Question]] = {name: [] for name in uris}
    seen: dict[str, str] = {}
    for source, questions in _question_files(config, uris):
        for question in questions:
            if question.question_id in seen:
                found = f"{question.question_id!r}, also in {seen[question.question_id]}"
                raise InputError(source, field="question_id", expected="an id no other question has", found=found)
            seen[question.question_id] = source
            if question.scene in asked:
                asked[question.scene].append(question)
            elif config.other_scenes == "refuse":
                raise InputError(
                    source,
                    field=f"scene of question {question.question_id!r}",
                    expected=f"one of the job's scenes ({_few(list(uris))})",
                    found=repr(question.scene),
                )
    kept = {name: [q for q in asked[name] if q.task in config.tasks][: config.limit] for name in uris}
    if not any(kept.values()):
        raise InputError(
            subject, field="questions", expected=f"a question of task {' or '.join(config.tasks)}", found="none"
        )
    return tuple(
        PlannedScene(name, uri, scene_sha256(uri), tuple(kept[name])) for name, uri in uris.items() if kept[name]
    )


def _question_files(config: JobConfig, uris: dict[str, str]) -> list[tuple[str, Sequence[Question]]]:
    if config.questions != IN_SCENE:
        return [(config.questions, load_questions(config.questions))]
    files = [storage.join(uri, QUESTIONS) for uri in uris.values()]
    return [(file, load_questions(file)) for file in files]


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:5])
    return shown if len(names) <= 5 else f"{shown} and {len(names) - 5} more"
