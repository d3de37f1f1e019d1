"""From a build job to its units: a capture each, with an id made of all that shapes its scene."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jobs.builds.build_job import BuildJob, CaptureEntry
from jobs.dataset import file_sha256
from jobs.runs.plan import ID_LENGTH, content_id
from jobs.runs.problems import Problems
from jobs.runs.versions import BUILD_STAGES
from pipeline.construct.semantics.labels_2d.choose import MAIN
from schemas import storage
from schemas.build_plan import PlannedCapture
from schemas.errors import InputError
from schemas.run_folder import safe_name

READ_SUFFIXES = (".txt", ".json")
"""Files of poses and lenses, which are read whole: a changed number keeps their size."""

READ_BYTES = 1 << 24
"""Larger ones count as photographs do."""

END_BYTES = 1 << 16
"""Of any other file the first and the last so many bytes are read. An image that was compressed anew differs from its
first changed row on, and in a checksum at its end; a raw array may differ in its middle alone, which goes unseen."""


@dataclass(frozen=True, slots=True)
class BuildBasis:
    """What, beside its capture, a scene depends on."""

    build: dict[str, Any]
    """Resolved config."""
    questions: str
    """Hash of the question file; empty without one."""
    stages: dict[str, int]
    """Version of each step's code."""


def build_basis(job: BuildJob) -> BuildBasis:
    """Return what a job's scenes depend on beside the captures.

    Raises:
        InputError: The question file cannot be read.
    """
    questions = "" if job.questions is None else file_sha256(job.questions)
    return BuildBasis(job.build.model_dump(mode="json"), questions, BUILD_STAGES)


def plan_captures(
    job: BuildJob, subject: object = "job", warn: Callable[[str], None] = lambda text: None
) -> tuple[PlannedCapture, ...]:
    """Return a job's captures, each opened once, so that all that is wrong shows before anything is built.

    Args:
        job: The job.
        subject: What messages call it, such as its file.
        warn: Told what is odd and no reason to refuse.

    Raises:
        InputError: A capture cannot be opened, two scenes have one name, or a question file is wrong; further
            problems are its notes.
    """
    from pipeline.scene.captures import open_capture

    problems, basis, planned = Problems(), build_basis(job), list[PlannedCapture]()
    places: dict[str, str] = {}
    for uri, entry in _found(job, subject, problems):
        try:
            capture = open_capture(uri, entry.kind, name=entry.name)
            files = inputs_sha256(job, uri, capture.name)
        except InputError as error:
            problems.add(error)
            continue
        for line in capture.warnings:
            warn(f"{uri}: {line}")
        folder = safe_name(capture.name)
        if folder in places:
            expected = "scenes of distinct names (give `name`)"
            found = f"{capture.name} of {places[folder]} and of {uri}"
            problems.add(InputError(subject, field="captures", expected=expected, found=found))
            continue
        places[folder] = uri
        content = {
            "capture": files,
            "name": capture.name,
            "kind": entry.kind,
            "build": basis.build,
            "questions": basis.questions,
            "stages": basis.stages,
        }
        unit = content_id(content)[:ID_LENGTH]
        planned.append(
            PlannedCapture(unit, len(planned), capture.name, uri, entry.kind, files, job.scene_folder(folder))
        )
    if job.questions is not None:
        _check_questions(job.questions, {one.scene for one in planned}, problems, warn)
    problems.refuse()
    return tuple(planned)


def _found(job: BuildJob, subject: object, problems: Problems) -> Iterator[tuple[str, CaptureEntry]]:
    """Yield the captures that entries name, patterns sorted."""
    for entry in job.captures:
        path = storage.local_path(entry.path)
        if path is None or not glob.has_magic(str(path)):
            yield entry.path, entry
            continue
        pattern = os.path.join(path, "") if entry.path.endswith("/") else str(path)
        matches = sorted(map(os.path.normpath, glob.glob(pattern, recursive=True)))
        if not matches:
            expected = "a pattern that matches captures"
            problems.add(InputError(subject, field="captures", expected=expected, found=entry.path))
        if entry.name and len(matches) > 1:
            found = f"{entry.name} for {len(matches)}"
            problems.add(InputError(subject, field="captures", expected="a name for one capture", found=found))
        yield from ((match, entry) for match in matches)


def inputs_sha256(job: BuildJob, uri: str, scene: str) -> str:
    """Return a hash of the files a scene is made from: its capture's, and those that name what is in it.

    Args:
        job: The job.
        uri: The capture.
        scene: Name of the scene.

    Raises:
        InputError: The capture has no file, or one cannot be read.
    """
    capture, source = capture_sha256(uri), job.build.semantics.source
    place = "" if source is None else str(getattr(source, MAIN[source.kind])).replace("{scene}", scene)
    # Models may also be named as on a hub, and what is missing is told by the source itself.
    if not place or storage.local_path(place) is None or not os.path.exists(place):
        return capture
    return hashlib.sha256(f"{capture} {capture_sha256(place)}".encode()).hexdigest()


def capture_sha256(uri: str) -> str:
    """Return a hash that tells a capture from another: names and sizes of its files, and what they hold.

    Poses and lenses are read whole, of photographs and depth both ends: hundreds of captures are terabytes.

    Raises:
        InputError: There is no file, or one cannot be read.
    """
    path = storage.local_path(uri)
    if path is None:
        names = storage.list_files(uri, recursive=True)
        return hashlib.sha256("\n".join(names).encode()).hexdigest()
    files = [path] if path.is_file() else sorted(one for one in path.rglob("*") if one.is_file())
    if not files:
        raise InputError(uri, expected="a capture", found="no file")
    whole = hashlib.sha256()
    for file in files:
        size, digest = _content(file)
        whole.update(f"{_below(file, path)} {size} {digest}\n".encode("utf-8", "surrogateescape"))
    return whole.hexdigest()


def _content(file: Path) -> tuple[int, str]:
    """Return the size of a file and a hash of what is read of it."""
    try:
        with file.open("rb") as opened:
            size = os.fstat(opened.fileno()).st_size
            if size <= 2 * END_BYTES or (size <= READ_BYTES and file.suffix.lower() in READ_SUFFIXES):
                return size, hashlib.sha256(opened.read()).hexdigest()
            ends = hashlib.sha256(opened.read(END_BYTES))
            opened.seek(-END_BYTES, os.SEEK_END)
            ends.update(opened.read())
            return size, ends.hexdigest()
    except OSError as error:
        raise InputError(file, expected="a file that can be read", found=error) from error


def _below(file: Path, root: Path) -> str:
    return file.relative_to(root).as_posix() if file != root else file.name


def _check_questions(uri: str, scenes: set[str], problems: Problems, warn: Callable[[str], None]) -> None:
    from schemas.question_file import load_questions

    try:
        named = {question.scene for question in load_questions(uri)}
    except InputError as error:
        problems.add(error)
        return
    if not named & scenes:
        expected = f"questions about one of {', '.join(sorted(scenes)[:5])}"
        problems.add(InputError(uri, field="scene", expected=expected, found=", ".join(sorted(named)[:5]) or "none"))
    elif without := sorted(scenes - named):
        warn(f"{uri}: no questions about {len(without)} scenes, such as {without[0]}")
