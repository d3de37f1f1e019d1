"""Question files: JSON Lines, one `Question` a line, read strictly and written back the same.

A line is an object whose keys are the fields of `Question`. `question_id`, `scene`, `task` and `question` must be
there; the rest have defaults. Unknown keys are refused, since a misspelt one would silently lose an answer. Blank
lines are allowed.
"""

from __future__ import annotations

import dataclasses
import io
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from schemas.errors import InputError
from schemas.questions import Question
from schemas.storage import read_bytes, write_bytes_atomic

_REQUIRED = ("question_id", "scene", "task", "question")
_FIELDS = tuple(field.name for field in dataclasses.fields(Question))


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a question file that is not blank."""

    number: int
    """From 1."""
    offset: int
    """Byte at which it begins."""
    question: Question | InputError
    """What it says, or what is wrong with it."""


def read_lines(stream: BinaryIO, subject: str) -> Iterator[Line]:
    """Yield the lines of a JSONL file one by one, each with its question or its own error.

    Args:
        stream: The file.
        subject: What messages call it.
    """
    offset = 0
    for number, line in enumerate(stream, start=1):
        place = f"{subject} line {number}"
        try:
            text = line.decode("utf-8-sig" if number == 1 else "utf-8")
            if number == 1 and text.lstrip().startswith("["):
                found = InputError(place, expected="JSON Lines: one object a line", found="a JSON list around them")
                yield Line(number, offset, found)
                return
            if text.strip():
                yield Line(number, offset, _question(_parse(text, place), place))
        except UnicodeDecodeError as error:
            found = InputError(place, expected="UTF-8 text", found=f"byte {offset + error.start} that is not")
            yield Line(number, offset, found)
        except InputError as error:
            yield Line(number, offset, error)
        offset += len(line)


def question_at(stream: BinaryIO, offset: int, subject: str) -> Question:
    """Return the question of the line that begins at a byte.

    Raises:
        InputError: There is none; the file has changed since `read_lines` found it.
    """
    stream.seek(offset)
    place = f"{subject} byte {offset}"
    try:
        return _question(_parse(stream.readline().decode("utf-8-sig" if offset == 0 else "utf-8"), place), place)
    except UnicodeDecodeError as error:
        raise InputError(place, expected="UTF-8 text", found=f"byte {offset + error.start} that is not") from error


def load_questions(uri: str | Path) -> tuple[Question, ...]:
    """Return the questions of a JSONL file, in file order.

    Args:
        uri: Local path or URI.

    Raises:
        InputError: The file is missing, empty or not UTF-8; a line is not a JSON object, lacks a field, has an
            unknown or wrongly typed one, names an unknown task or repeats a question id. The message names the line.
    """
    uri = str(uri)
    questions: list[Question] = []
    first_line: dict[str, int] = {}
    for line in read_lines(io.BytesIO(read_bytes(uri)), uri):
        question = line.question
        if isinstance(question, InputError):
            raise question
        if question.question_id in first_line:
            raise InputError(
                f"{uri} line {line.number}",
                field="question_id",
                expected="an id no other line has",
                found=f"{question.question_id!r}, already on line {first_line[question.question_id]}",
            )
        first_line[question.question_id] = line.number
        questions.append(question)
    if not questions:
        raise no_question(uri)
    return tuple(questions)


def no_question(uri: str) -> InputError:
    """Return the error of a file without a question."""
    return InputError(uri, expected="at least one question, one JSON object a line", found="an empty file")


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


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        ((name, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise _RepeatedFieldError(name)
    return record


class _RepeatedFieldError(Exception):
    """An object has a field twice."""


_DECODER = json.JSONDecoder(object_pairs_hook=_unique)


def _parse(line: str, subject: str) -> dict[str, Any]:
    try:
        record = _DECODER.decode(line)
        if "\\u" in line:
            json.dumps(record, ensure_ascii=False).encode()
    except _RepeatedFieldError as error:
        raise InputError(subject, field=str(error), expected="each field once", found="it twice") from None
    except json.JSONDecodeError as error:
        found = f"{error.msg} at column {error.colno}"
        raise InputError(subject, expected="a JSON object on one line", found=found) from error
    except UnicodeEncodeError as error:
        raise InputError(subject, expected="text", found="half of a surrogate pair") from error
    except (ValueError, RecursionError) as error:
        # A number of thousands of digits, or thousands of brackets.
        raise InputError(subject, expected="a JSON object on one line", found=error) from error
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
    if targets is not None and (not isinstance(targets, list) or not all(_is_id(i) for i in targets)):
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


def _is_id(value: object) -> bool:
    return type(value) is int and -(2**63) <= value < 2**63


def _json_type(value: object) -> str:
    names = {list: "list", str: "text", bool: "true/false", int: "number", float: "number", type(None): "null"}
    return names.get(type(value), type(value).__name__)


def _shown(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
