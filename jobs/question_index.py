"""Where a job's questions lie, found and checked in one reading of their files, a line in memory at a time.

What is kept of a question is its place and a digest of its id: about 36 bytes, so a million of them are some tens of
megabytes and the questions themselves are read again when their scene's turn comes.
"""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Int64

from jobs.runs.problems import Problems
from schemas import storage
from schemas.errors import InputError
from schemas.question_file import no_question, question_at, read_lines
from schemas.questions import Question, Task

DIGEST_BYTES = 16
"""Bytes of an id's digest: no two ids of any number share one."""


class QuestionIndex:
    """The questions of a job by scene, on disk; those of official files, some ten thousand at most, in memory.

    Args:
        scenes: Names of the job's scenes, in order.
        tasks: Tasks to keep.
        limit: First questions of each scene to keep; None for all.
        refuse_others: Whether a question about another scene is a problem.
    """

    def __init__(self, scenes: Sequence[str], tasks: Sequence[Task], limit: int | None, *, refuse_others: bool) -> None:
        self._numbers = {name: number for number, name in enumerate(scenes)}
        self._tasks, self._limit, self._refuse_others = frozenset(tasks), limit, refuse_others
        self._files: list[str] = []
        self._held: dict[int, Sequence[Question]] = {}
        self._counts = [0] * len(scenes)
        self._asked: set[tuple[str, Task]] = set()
        # One entry a question: file, line, byte, and the number of its scene or -1 where it is not kept.
        self._file, self._line, self._offset, self._scene = array("i"), array("q"), array("q"), array("i")
        self._digests = bytearray()
        self._order: Int64[np.ndarray, "n"] | None = None

    @property
    def kept(self) -> int:
        """Questions kept."""
        return sum(self._counts)

    def has(self, scene: str, tasks: Iterable[Task]) -> bool:
        """Return whether a question of any of the tasks is kept for a scene."""
        return any((scene, task) in self._asked for task in tasks)

    def read(self, uri: str, problems: Problems) -> None:
        """Take in a question file."""
        self._files.append(uri)
        found = 0
        try:
            with storage.local_copy(uri) as path, path.open("rb") as stream:
                for line in read_lines(stream, uri):
                    found += 1
                    if isinstance(line.question, InputError):
                        problems.add(line.question)
                    else:
                        self._add(line.question, line.number, line.offset, problems)
        except (InputError, OSError) as error:
            if not isinstance(error, InputError):
                error = InputError(uri, expected="a file that can be read", found=error.strerror or error)
            problems.add(error)
            return
        if not found:
            problems.add(no_question(uri))

    def take(self, source: str, questions: Sequence[Question], problems: Problems) -> None:
        """Take in questions that are in memory, such as those of an official file."""
        self._files.append(source)
        self._held[len(self._files) - 1] = questions
        for number, question in enumerate(questions):
            self._add(question, number + 1, number, problems)

    def _add(self, question: Question, line: int, offset: int, problems: Problems) -> None:
        number = self._numbers.get(question.scene, -1)
        if number < 0 and self._refuse_others:
            problems.add(
                InputError(
                    self._where(len(self._files) - 1, line),
                    field=f"scene of question {question.question_id!r}",
                    expected=f"one of the job's scenes ({_few(list(self._numbers))})",
                    found=repr(question.scene),
                )
            )
        full = number >= 0 and self._limit is not None and self._counts[number] >= self._limit
        if question.task not in self._tasks or full:
            number = -1
        if number >= 0:
            self._counts[number] += 1
            self._asked.add((question.scene, question.task))
        self._file.append(len(self._files) - 1)
        self._line.append(line)
        self._offset.append(offset)
        self._scene.append(number)
        self._digests += hashlib.sha256(question.question_id.encode()).digest()[:DIGEST_BYTES]

    def find_repeated(self, problems: Problems) -> None:
        """Tell which ids stand twice, within a file and across files."""
        halves = np.frombuffer(self._digests, np.uint64).reshape(-1, 2)
        order = np.lexsort((halves[:, 1], halves[:, 0]))  # stable: of equal ids the first read comes first
        same = (halves[order[1:]] == halves[order[:-1]]).all(axis=1)
        for place in np.flatnonzero(same):
            first, again = int(order[place]), int(order[place + 1])
            with self._opened() as files:
                question_id = self._question(files, again).question_id
            problems.add(
                InputError(
                    self._place(again),
                    field="question_id",
                    expected="an id no other question has",
                    found=f"{question_id!r}, also in {self._place(first)}",
                )
            )

    def by_scene(self) -> Iterator[tuple[str, tuple[Question, ...]]]:
        """Yield each scene that has questions, with them in file order.

        Raises:
            InputError: A file has changed since it was read.
        """
        numbers = np.frombuffer(self._scene, np.int32)
        order = np.argsort(numbers, kind="stable")
        ends = np.cumsum(np.bincount(numbers + 1, minlength=len(self._numbers) + 1))
        with self._opened() as files:
            for name, number in self._numbers.items():
                own = order[ends[number] : ends[number + 1]]
                if len(own):
                    yield name, tuple(self._question(files, int(place)) for place in own)

    def _opened(self) -> _OpenFiles:
        return _OpenFiles(self._files)

    def _question(self, files: _OpenFiles, place: int) -> Question:
        number = self._file[place]
        if number in self._held:
            return self._held[number][self._offset[place]]
        return question_at(files.get(number), self._offset[place], self._files[number])

    def _place(self, place: int) -> str:
        return self._where(self._file[place], self._line[place])

    def _where(self, file: int, line: int) -> str:
        return f"{self._files[file]} {'question' if file in self._held else 'line'} {line}"


class _OpenFiles:
    """Question files, one open at a time, as a context manager."""

    def __init__(self, uris: Sequence[str]) -> None:
        self._uris = uris
        self._stack = ExitStack()
        self._open: tuple[int, BinaryIO] | None = None

    def __enter__(self) -> _OpenFiles:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def get(self, number: int) -> BinaryIO:
        """Return a file, opened."""
        if self._open is None or self._open[0] != number:
            self._stack.close()
            path: Path = self._stack.enter_context(storage.local_copy(self._uris[number]))
            self._open = number, self._stack.enter_context(path.open("rb"))
        return self._open[1]


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:5])
    return shown if len(names) <= 5 else f"{shown} and {len(names) - 5} more"
