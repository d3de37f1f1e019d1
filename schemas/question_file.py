"""Question files: JSON Lines, one `Question` a line, read strictly and written back the same.

A line is an object whose keys are the fields of `Question`. `question_id`, `scene`, `task` and `question` must be
there; the rest have defaults. Unknown keys are refused, since a misspelt one would silently lose an answer. Blank
lines are allowed.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from schemas.errors import InputError
from schemas.questions import Question
from schemas.storage import read_bytes, write_bytes_atomic

_REQUIRED = ("question_id", "scene", "task", "question")
_FIELDS = tuple(field.name for field in dataclasses.fields(Question))


def load_questions(uri: str | Path) -> tuple[Question, ...]:
    """Return the questions of a JSONL file, in file order.

    Args:
        uri: Local path or URI.

    Raises:
        InputError: The file is missing, empty or not UTF-8; a line is not a JSON object, lacks a field, has an
            unknown or wrongly typed one, names an unknown task or repeats a question id. The message names the line.
    """
    uri = str(uri)
    try:
        lines = read_bytes(uri).decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise InputError(uri, expected="UTF-8 text", found=f"byte {error.start} that is not") from error
    questions: list[Question] = []
    first_line: dict[str, int] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        subject = f"{uri} line {number}"
        question = _question(_parse(line, subject), subject)
        if question.question_id in first_line:
            raise InputError(
                subject,
                field="question_id",
                expected="an id no other line has",
                found=f"{question.question_id!r}, already on line {first_line[question.question_id]}",
            )
        first_line[question.question_id] = number
        questions.append(question)
    if not questions:
        raise InputError(uri, expected="at least one question, one JSON object a line", found="an empty file")
    return tuple(questions)


def save_questions(questions: Iterable[Question], path: str | Path) -> None:
    """Write questions as JSONL, atomically; fields at their defaults are left out."""
    lines = [json.dumps(_record(question), ensure_ascii=False) + "\n" for question in questions]
    write_bytes_atomic(str(path), "".join(lines).encode())


def _record(question: Question) -> dict[str, object]:
    record: dict[str, object] = {}
    for field in dataclasses.fields(question):
        value = getattr(question, field.name)
        if value != field.default:
            record[field.name] = list(value) if isinstance(value, tuple) else value
    return record


def _parse(line: str, subject: str) -> dict[str, Any]:
    def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in pairs]
        for name in names:
            if names.count(name) > 1:
                raise InputError(subject, field=name, expected="each field once", found="it twice")
        return dict(pairs)

    try:
        record = json.loads(line, object_pairs_hook=unique_keys)
    except json.JSONDecodeError as error:
        found = f"{error.msg} at column {error.colno}"
        raise InputError(subject, expected="a JSON object on one line", found=found) from error
    if not isinstance(record, dict):
        raise InputError(subject, expected="a JSON object", found=f"a JSON {_json_type(record)}")
    return record


def _question(record: dict[str, Any], subject: str) -> Question:
    for name in record:
        if name not in _FIELDS:
            raise InputError(subject, field=name, expected=f"one of the fields {', '.join(_FIELDS)}", found="that name")
    for name in _REQUIRED:
        if name not in record:
            raise InputError(subject, field=name, expected="a text", found="no such field")
    for name in ("question_id", "scene", "task", "question", "category", "target_category"):
        if not isinstance(record.get(name, ""), str):
            raise InputError(subject, field=name, expected="a text", found=_shown(record[name]))
    if not isinstance(record.get("answer"), str | None):
        raise InputError(subject, field="answer", expected="a text or null", found=_shown(record["answer"]))
    extra = record.get("extra_answers", [])
    if not isinstance(extra, list) or not all(isinstance(text, str) for text in extra):
        raise InputError(subject, field="extra_answers", expected="a list of texts", found=_shown(extra))
    targets = record.get("target_ids")
    if targets is not None and (not isinstance(targets, list) or not all(type(i) is int for i in targets)):
        raise InputError(subject, field="target_ids", expected="a list of whole numbers or null", found=_shown(targets))
    if targets is not None and len(set(targets)) < len(targets):
        raise InputError(subject, field="target_ids", expected="each id once", found=_shown(targets))
    try:
        return Question(
            **{
                **record,
                "extra_answers": tuple(extra),
                "target_ids": None if targets is None else tuple(targets),
            }
        )
    except InputError as error:
        raise InputError(subject, field=error.field, expected=error.expected, found=error.found) from error


def _json_type(value: object) -> str:
    names = {list: "list", str: "text", bool: "true/false", int: "number", float: "number", type(None): "null"}
    return names.get(type(value), type(value).__name__)


def _shown(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
