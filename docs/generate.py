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
        place = f"{path.partition(', kind ')[0]}.{name}" if path else name
        if len(nested) > 1:  # methods: the paper's first, by its place alone
            kinds = [model.model_fields["kind"].default for model in nested]
            queue += [
                (place if number == 0 else f"{place}, kind {kind}", model)
                for number, (kind, model) in enumerate(zip(kinds, nested, strict=True))
            ]
            default = "see below"
        elif nested:
            map_key = "" if nested[0] is field.annotation else ".NAME"
            queue.append((place + map_key, nested[0]))
            default = "see below"
        else:
            default = "required" if field.is_required() else f"`{_plain(field)}`"
        lines.append(f"| `{name}` | {default} | {(field.description or '').replace('|', '/')} |")
    return "\n".join([*lines, ""])


def _nested(annotation: Any) -> list[type[BaseModel]]:
    """Return the models a field holds: one by itself or as the values of a map, or several to choose from."""
    candidates = (annotation, *getattr(annotation, "__args__", ()))
    return [one for one in candidates if isinstance(one, type) and issubclass(one, BaseModel)]


def _plain(field: Any) -> str:
    """Return a default as YAML would have it."""
    value = field.default if field.default is not PydanticUndefined else field.default_factory()
    return value if isinstance(value, str) and value else json.dumps(value, default=list)


if __name__ == "__main__":
    target = Path(__file__).with_name("job.md")
    target.write_text(job_reference())
    print(target)
