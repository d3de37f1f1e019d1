"""Write docs/job.md and docs/build_job.md from the job files' own field descriptions: `python docs/generate.py`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from jobs.build_job import BuildJob
from jobs.config import DEFAULT_METHOD, JobConfig

HEAD = """# Job files

A run that answers questions; files for `build` are in [build_job.md](build_job.md).

A job file is YAML. Paths in it are relative to the file. Unknown fields are refused. Below is every field with its
default and its meaning, made by
`python docs/generate.py` from the code that checks them.
"""

BUILD_HEAD = """# Build job files

A run that builds scenes from captures ([building.md](building.md)): `splatreasoner build --job FILE`. YAML; paths in it
are relative to the file. Unknown fields are refused. Made by `python docs/generate.py` from the code that checks them.
"""


def job_reference(root: type[BaseModel] = JobConfig, head: str = HEAD) -> str:
    """Return the text of docs/job.md, or of that on another root."""
    parts: list[str] = [head]
    queue: list[tuple[str, Any]] = [("", root)]
    seen: set[Any] = set()
    while queue:
        path, model = queue.pop(0)
        if model in seen:
            continue
        seen.add(model)
        parts.append(_section(path, model, queue))
    return "\n".join(parts)


def _section(path: str, model: type[BaseModel], queue: list[tuple[str, Any]]) -> str:
    lines = [f"## {path or 'top level'}", "", (model.__doc__ or "").strip().split("\n\n")[0].replace("\n    ", " "), ""]
    lines += ["| field | default | meaning |", "|---|---|---|"]
    for name, field in model.model_fields.items():
        nested = _nested(field.annotation)
        place = f"{path.partition(', kind ')[0]}.{name}" if path else name
        if len(nested) > 1:  # methods: the paper's first, by its place alone
            kinds = [_kind(model) for model in nested]
            queue += [
                (place if kind == DEFAULT_METHOD else f"{place}, kind {kind}", model)
                for kind, model in zip(kinds, nested, strict=True)
            ]
            default = "see below"
        elif nested:
            map_key = ".NAME" if get_origin(field.annotation) in (dict, Mapping) else ""
            queue.append((place + map_key, nested[0]))
            default = "see below"
        else:
            default = "required" if field.is_required() else f"`{_plain(field)}`"
        lines.append(f"| `{name}` | {default} | {(field.description or '').replace('|', '/')} |")
    return "\n".join([*lines, ""])


def _kind(model: type[BaseModel]) -> str:
    """Return the kind by which one of several models is chosen, or the kinds."""
    field = model.model_fields["kind"]
    return " or ".join(get_args(field.annotation)) if field.is_required() else field.default


def _nested(annotation: Any) -> list[type[BaseModel]]:
    """Return the models a field holds: one by itself or as the values of a map, or several to choose from."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    # In whatever holds it: a list, a map, a union with null, kinds to choose from.
    return [model for one in getattr(annotation, "__args__", ()) for model in _nested(one)]


def _plain(field: Any) -> str:
    """Return a default as YAML would have it."""
    value = field.default if field.default is not PydanticUndefined else field.default_factory()
    return value if isinstance(value, str) and value else json.dumps(value, default=list)


if __name__ == "__main__":
    for name, text in (("job.md", job_reference()), ("build_job.md", job_reference(BuildJob, BUILD_HEAD))):
        target = Path(__file__).with_name(name)
        target.write_text(text)
        print(target)
