"""objects.json: the ground-truth objects of a scene. Question generators and metrics read it, the method never does."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any, get_args

from pipeline.scene.objects import Relation, SceneObject
from schemas.errors import InputError
from schemas.storage import read_bytes

VERSION = 1

_REQUIRED = ("instance", "category", "color", "center", "half_extents")


def objects_json(objects: Sequence[SceneObject]) -> bytes:
    """Return an objects.json."""
    document = {"version": VERSION, "objects": [asdict(item) for item in objects]}
    return json.dumps(document, indent=1, allow_nan=False).encode()


def read_objects(uri: str) -> tuple[SceneObject, ...]:
    """Return the objects of an objects.json.

    Raises:
        InputError: The file is missing or no JSON, a field is missing, unknown or of another type, or two objects
            share an instance id.
    """
    try:
        document = json.loads(read_bytes(uri))
    except (ValueError, RecursionError) as error:
        raise InputError(uri, expected="JSON", found=error) from error
    if not isinstance(document, dict) or document.get("version") != VERSION:
        found = document.get("version") if isinstance(document, dict) else type(document).__name__
        raise InputError(uri, field="version", expected=str(VERSION), found=found)
    entries = document.get("objects")
    if not isinstance(entries, list):
        raise InputError(uri, field="objects", expected="a list", found=type(entries).__name__)
    objects = tuple(_object(f"{uri} object {i}", entry) for i, entry in enumerate(entries))
    instances = [item.instance for item in objects]
    if len(set(instances)) != len(instances):
        raise InputError(uri, field="instance", expected="distinct ids", found="a repeated id")
    return objects


def _object(subject: str, entry: Any) -> SceneObject:
    known = [item.name for item in fields(SceneObject)]
    if not isinstance(entry, dict) or set(entry) - set(known) or not set(_REQUIRED) <= set(entry):
        found = sorted(entry) if isinstance(entry, dict) else type(entry).__name__
        raise InputError(subject, expected=f"{', '.join(_REQUIRED)} and no field but {', '.join(known)}", found=found)
    relation = entry.get("relation", "")
    if relation not in get_args(Relation):
        raise InputError(subject, field="relation", expected=f"one of {get_args(Relation)}", found=relation)
    states = entry.get("states", [])
    if not isinstance(states, list) or not all(isinstance(state, str) for state in states):
        raise InputError(subject, field="states", expected="a list of words", found=states)
    return SceneObject(
        instance=_integer(subject, entry, "instance"),
        category=_text(subject, entry, "category"),
        color=_text(subject, entry, "color"),
        center=_triple(subject, entry, "center"),
        half_extents=_triple(subject, entry, "half_extents"),
        yaw=_number(subject, "yaw", entry.get("yaw", 0.0)),
        room=_text(subject, {"room": "", **entry}, "room"),
        states=tuple(states),
        parent=_integer(subject, {"parent": -1, **entry}, "parent"),
        relation=relation,
    )


def _integer(subject: str, entry: dict[str, Any], key: str) -> int:
    value = entry[key]
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(subject, field=key, expected="a whole number", found=value)
    return value


def _text(subject: str, entry: dict[str, Any], key: str) -> str:
    value = entry[key]
    if not isinstance(value, str):
        raise InputError(subject, field=key, expected="a text", found=value)
    return value


def _number(subject: str, key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(subject, field=key, expected="a finite number", found=value)
    return float(value)


def _triple(subject: str, entry: dict[str, Any], key: str) -> tuple[float, float, float]:
    value = entry[key]
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(subject, field=key, expected="three numbers", found=value)
    x, y, z = (_number(subject, key, part) for part in value)
    return x, y, z
