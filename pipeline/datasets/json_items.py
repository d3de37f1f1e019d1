"""Official question files: a JSON list of items, each field read strictly, errors naming file, item and field.

Fields we do not use are left alone: the official files carry tokens and flags of other people's code.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from schemas.errors import InputError
from schemas.storage import read_bytes


@dataclass(frozen=True, slots=True)
class Item:
    """One entry of a question file."""

    subject: str
    """File and position, for messages."""
    fields: dict[str, Any]
    """What it holds."""

    def has(self, name: str) -> bool:
        """Return whether the field is there."""
        return name in self.fields

    def text(self, name: str) -> str:
        """Return a text that is not empty, as it stands.

        Raises:
            InputError: It is missing, empty or no text.
        """
        value = self.fields.get(name)
        if not isinstance(value, str) or not value.strip():
            raise self.error(name, "a text that is not empty")
        return value

    def one_of(self, name: str, known: tuple[str, ...]) -> str:
        """Return a text that is one of the known ones.

        Raises:
            InputError: It is something else.
        """
        value = self.text(name)
        if value not in known:
            raise self.error(name, f"one of {', '.join(known)}")
        return value

    def integer(self, name: str) -> int:
        """Return a whole number from 0 up; the official files write some as texts.

        Raises:
            InputError: It is missing or something else.
        """
        value = self.fields.get(name)
        if isinstance(value, str) and value.isdecimal():
            return int(value)
        if type(value) is not int or value < 0:
            raise self.error(name, "a whole number from 0 up")
        return value

    def integers(self, name: str) -> tuple[int, ...]:
        """Return a list of different whole numbers from 0 up.

        Raises:
            InputError: It is missing, something else, or repeats a number.
        """
        value = self.fields.get(name)
        if not isinstance(value, list) or not all(type(i) is int and i >= 0 for i in value):
            raise self.error(name, "a list of whole numbers from 0 up")
        if len(set(value)) < len(value):
            raise self.error(name, "each number once")
        return tuple(value)

    def texts(self, name: str) -> tuple[str, ...]:
        """Return a list of texts without the blank ones; empty where the field is missing.

        Raises:
            InputError: It is something else.
        """
        value = self.fields.get(name, [])
        if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
            raise self.error(name, "a list of texts")
        return tuple(text for text in value if text.strip())

    def error(self, field: str, expected: str) -> InputError:
        """Return the error of a field that is not as expected."""
        found = json.dumps(self.fields[field], ensure_ascii=False)[:60] if field in self.fields else "no such field"
        return InputError(self.subject, field=field, expected=expected, found=found)


def read_items(uri: str) -> tuple[Item, ...]:
    """Return the items of a JSON file, in file order.

    Raises:
        InputError: The file is missing, no JSON, no list, empty, or an entry is no object.
    """
    entries = read_list(uri)
    for i, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise InputError(f"{uri} item {i}", expected="a JSON object", found=type(entry).__name__)
    return tuple(Item(f"{uri} item {i}", entry) for i, entry in enumerate(entries))


def read_list(uri: str) -> list[Any]:
    """Return a JSON file's list of at least one entry.

    Raises:
        InputError: The file is missing, no JSON, no list, or empty.
    """
    document = read_json(uri)
    if not isinstance(document, list) or not document:
        found = "an empty list" if isinstance(document, list) else type(document).__name__
        raise InputError(uri, expected="a JSON list of at least one entry", found=found)
    return document


def read_json(uri: str) -> Any:
    """Return what a JSON file holds.

    Raises:
        InputError: The file is missing or no JSON.
    """
    try:
        return json.loads(read_bytes(uri))
    except (ValueError, RecursionError) as error:
        raise InputError(uri, expected="JSON", found=error) from error
