"""Marks of another judge: OpenEQA's metrics file `{question_id: mark}` in place of a run's own marks."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import pandas as pd

from jobs.scoring.coverage import Coverage
from schemas.errors import InputError
from schemas.storage import read_bytes


@dataclass(frozen=True, slots=True)
class Remarked:
    """A run with marks from a file."""

    covered: Coverage
    """The rows of one arm's answered questions, the file's marks in place of the run's."""
    used: int
    """Marks that a question of the run took."""
    others: int
    """Marks of questions that the run does not answer."""


def read_marks(uri: str) -> dict[str, int]:
    """Return the marks of a metrics file as OpenEQA's tool writes it, by question id.

    Raises:
        InputError: The file is missing, not JSON, or holds something else than whole numbers by question id.
    """
    try:
        found = json.loads(read_bytes(uri).decode())
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(uri, expected="JSON, {question_id: mark}", found=error) from error
    if not isinstance(found, dict):
        raise InputError(uri, expected="a JSON object, {question_id: mark}", found=f"a {type(found).__name__}")
    for name, mark in found.items():
        if type(mark) is not int:
            raise InputError(uri, field=name, expected="a whole number", found=repr(mark))
    return found


def with_marks(covered: Coverage, marks: dict[str, int], arm: str) -> Remarked:
    """Return one arm of a run with other marks. A question that the file lacks is unscored.

    A question without an answer stays so, whatever the file says of it.

    Raises:
        InputError: The run has no such arm of eqa questions.
    """
    arms = covered.arms[(covered.arms["arm"] == arm) & (covered.arms["task"] == "eqa")]
    if arms.empty:
        there = ", ".join(dict.fromkeys(covered.arms[covered.arms["task"] == "eqa"]["arm"])) or "none: no eqa questions"
        raise InputError("--marks", field="arm", expected=f"one of {there}", found=arm)
    answered = (arms["status"] == "answered").tolist()
    new = [marks.get(name) if there else None for name, there in zip(arms["question_id"], answered, strict=True)]
    used = sum(mark is not None for mark in new)
    remarked = arms.assign(mark=pd.Series(new, arms.index, dtype=object))
    return Remarked(replace(covered, arms=remarked), used, len(marks) - used)
