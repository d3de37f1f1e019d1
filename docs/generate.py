"""Write docs/job.md from the job file's own field descriptions: `python docs/generate.py`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from jobs.config import JobConfig

HEAD = """# Job files

A job file is YAML. Paths in it are relative to the file. Unknown fields are refused. Below is every field with its
default and its meaning, made by
`python docs/generate.py` from the code that checks them.
"""


def job_reference() -> str:
    """Return the text of docs/job.md."""
    parts, queue, seen = [HEAD], [("", JobConfig)], set()
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
        place = f"{path}.{name}" if path else name
        if nested is not None:
            map_key = "" if nested is field.annotation else ".NAME"
            queue.append((place + map_key, nested))
            default = "see below"
        else:
            default = "required" if field.is_required() else f"`{_plain(field)}`"
        lines.append(f"| `{name}` | {default} | {(field.description or '').replace('|', '/')} |")
    return "\n".join([*lines, ""])


def _nested(annotation: Any) -> type[BaseModel] | None:
    """Return the model a field holds, by itself or as the values of a map."""
    for candidate in (annotation, *getattr(annotation, "__args__", ())):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def _plain(field: Any) -> str:
    """Return a default as YAML would have it."""
    value = field.default if field.default is not PydanticUndefined else field.default_factory()
    return value if isinstance(value, str) and value else json.dumps(value, default=list)


if __name__ == "__main__":
    target = Path(__file__).with_name("job.md")
    target.write_text(job_reference())
    print(target)
