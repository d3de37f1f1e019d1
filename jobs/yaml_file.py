"""YAML files that a person writes: safe-loaded, one mapping, every key once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from schemas.errors import InputError
from schemas.storage import read_bytes


class _UniqueKeys(yaml.SafeLoader):
    """A safe loader that refuses a key given twice, which YAML forbids and PyYAML lets through."""


def _mapping(loader: _UniqueKeys, node: yaml.MappingNode) -> dict[Any, Any]:
    seen = set()
    for key_node, _ in node.value:
        key = str(loader.construct_object(key_node))
        if key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} a second time", key_node.start_mark)
        seen.add(key)
    found: dict[Any, Any] = loader.construct_mapping(node, deep=True)
    return found


_UniqueKeys.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        InputError: The file is missing, not UTF-8, not YAML, or holds something else than a mapping.
    """
    try:
        found = yaml.load(read_bytes(str(path)).decode(), _UniqueKeys)
    except UnicodeDecodeError as error:
        raise InputError(path, expected="UTF-8 text", found=f"byte {error.start} that is not") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = "" if mark is None else f" at line {mark.line + 1}, column {mark.column + 1}"
        raise InputError(
            path, expected="YAML", found=f"{(error.problem or str(error)).removeprefix('found ')}{place}"
        ) from error
    except yaml.YAMLError as error:
        raise InputError(path, expected="YAML", found=str(error).splitlines()[0]) from error
    if not isinstance(found, dict):
        kind = "an empty file" if found is None else f"a {type(found).__name__}"
        raise InputError(path, expected="fields, one `name: value` a line", found=kind)
    return found
