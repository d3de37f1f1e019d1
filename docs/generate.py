"""Write the pages that code describes: job files, tables, commands and benchmarks. `python docs/generate.py`."""

from __future__ import annotations

import ast
import importlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from jobs.builds.build_job import BuildJob
from jobs.config import DEFAULT_METHOD, JobConfig
from schemas.build_plan import BUILD_PLAN
from schemas.plan import PLAN
from schemas.replies import STORED_REPLIES
from schemas.table import TableSpec
from schemas.tables import ALL_TABLES

DOCS = Path(__file__).resolve().parent

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


COLUMNS_HEAD = """# Columns of every table

What a run folder holds, made by `python docs/generate.py` from the records that are written. A `?` marks a column that
may be null. `schemas.run_folder.read_table(run, name)` reads the tables of a run; `aggregate` writes some of them whole
into `results/`. Columns are only ever added; "since" is the version that brought one, and older parts are read with a
default in its place.
"""

FILES = {
    "plan": "`plan.parquet` of a run that answers questions.",
    "build_plan": "`plan.parquet` of a run that builds scenes.",
    "replies": "What `splatreasoner cache export` writes.",
}
"""Tables that are no parts of a run."""

OTHER_COLUMNS = """## semantics

`semantics.parquet` of a scene, a row a Gaussian in the order of the splat file. At least one column is there; the
vocabulary, a list of names, lies in the file's metadata. Written by `schemas.semantics_table.write_semantics`.

| column | type | meaning |
|---|---|---|
| `category_id` | int32 | index into the vocabulary, -1 unlabelled |
| `embedding` | fixed-size list of float16 or float32 | open-set feature, unit norm; all zero is unlabelled |
| `instance_id` | int32 | ground-truth instance, -1 none; read by scores alone |

## visibility

The visibility index, Arrow files in `visibility/`: a row a rendered view with the ids of the Gaussians that dominate a
pixel of it ([visibility](visibility.md)).
"""


def column_reference() -> str:
    """Return the text of docs/columns.md."""
    specs = [*ALL_TABLES.values(), PLAN, BUILD_PLAN, STORED_REPLIES]
    return "\n".join([COLUMNS_HEAD, *map(_table, specs), OTHER_COLUMNS])


def _table(spec: TableSpec[Any]) -> str:
    told, fields = _record(spec.record)
    told = re.sub(r"^Table `\w+`: ", "", told)
    about = FILES.get(spec.name, "")
    lines = [f"## {spec.name}", "", f"{about} {told[:1].upper() + told[1:]}".strip(), ""]
    lines += [
        f"Version {spec.version}; a row is told from the others by {', '.join(f'`{name}`' for name in spec.key)}."
    ]
    lines += ["", "| column | type | meaning | since |", "|---|---|---|---|"]
    for name, kind in spec.columns.items():
        since = spec.added[name].version if name in spec.added else 1
        lines.append(f"| `{name}` | {kind.replace('<', ' of ').replace('>', '')} | {_cell(fields[name])} | {since} |")
    return "\n".join([*lines, ""])


def _record(record: type) -> tuple[str, dict[str, str]]:
    """Return a record's first line and the line beneath each of its fields."""
    source = Path(str(importlib.import_module(record.__module__).__file__)).read_text()
    (node,) = [n for n in ast.parse(source).body if isinstance(n, ast.ClassDef) and n.name == record.__name__]
    fields = {}
    for one, after in zip(node.body, node.body[1:], strict=False):
        if isinstance(one, ast.AnnAssign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            fields[ast.unparse(one.target)] = " ".join(str(after.value.value).split())
    return " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split()), fields


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


COMMANDS_HEAD = """# Commands

Made by `python docs/generate.py` from the command line itself; `splatreasoner VERB --help` says the same. Exit codes: 0
complete, 1 ended early or failed, 2 wrong input, 130 stopped by a signal. Progress goes to standard error, results to
standard output.

## Shell completion

```console
$ splatreasoner --install-completion        # bash, zsh, fish or PowerShell; then open a new shell
$ splatreasoner --show-completion           # prints the script instead
```
"""


def command_reference() -> str:
    """Return the text of docs/commands.md."""
    from typer.main import get_command

    from jobs.cli import app

    group = get_command(app)
    parts = [COMMANDS_HEAD]
    for name, verb in group.commands.items():  # type: ignore[attr-defined]
        words = [_names(one)[0] if one.required else f"[{_names(one)[0]}]" for one in verb.params if _is_argument(one)]
        text, _, examples = _plain_help(verb.help or "").partition("Example")
        shown = [" ".join(line.split()) for line in re.findall(r"`([^`]+)`", examples)]
        parts += [
            f"## {name}",
            "",
            "```",
            " ".join(["splatreasoner", name, *words, "[OPTIONS]"]),
            "```",
            "",
            text.strip(),
            "",
        ]
        parts += ["```console", *(f"$ {line}" for line in shown), "```", ""]
        parts += ["| argument or option | default | meaning |", "|---|---|---|"]
        parts += [_parameter(one) for one in verb.params if one.name != "help"]
        parts.append("")
    return "\n".join(parts)


def _plain_help(text: str) -> str:
    """Return a help text with its examples, which stand in bold, as code."""
    return re.sub(r"\[bold\](.+?)\[/bold\]", r"`\1`", text, flags=re.DOTALL)


def _parameter(one: Any) -> str:
    absent = one.default is None or one.default is False or one.default == ""
    default = "required" if one.required else "" if absent else f"`{one.default}`"
    return f"| {', '.join(f'`{name}`' for name in _names(one))} | {default} | {_cell(one.help or '')} |"


def _names(one: Any) -> list[str]:
    return [one.metavar or one.name.upper()] if _is_argument(one) else [*one.opts, *one.secondary_opts]


def _is_argument(one: Any) -> bool:
    return bool(one.param_type_name == "argument")


PERFORMANCE_HEAD = """# Performance

The command of every benchmark and what it shows, made by `python docs/generate.py` from the benchmarks themselves. Each
prints its figures; those of one machine stand in the pages that are named, with what they mean. Commands run in a
clone, in `.venv`; `$SPLATREASONER_DATA` names the folder of real scenes. On a machine that does other work compare CPU
seconds, and ratios within one run.

| what it shows | command | figures |
|---|---|---|
"""


def performance_reference() -> str:
    """Return the text of docs/performance.md."""
    pages = {path.stem: path.read_text() for path in sorted(DOCS.glob("*.md")) if path.stem not in WRITTEN}
    rows = []
    for path in sorted((DOCS.parent / "benchmarks").glob("*.py")):
        source = path.read_text()
        if "__main__" not in source:
            continue
        text = ast.get_docstring(ast.parse(source)) or ""
        what = " ".join(text.split("\n\n")[0].split()).rstrip(".")
        calls = [line.split("#")[0].strip() for line in text.splitlines() if "python " in line.split("#")[0]]
        calls = [line[line.index("python ") :] for line in calls] or [f"python -m benchmarks.{path.stem}"]
        told = [page for page, words in pages.items() if re.search(rf"benchmarks[./]{path.stem}\b", words)]
        figures = ", ".join(f"[{page.replace('_', ' ')}]({page}.md)" for page in told)
        rows.append(f"| {_cell(what)} | {'<br>'.join(f'`{_cell(line)}`' for line in calls)} | {figures} |")
    return PERFORMANCE_HEAD + "\n".join(rows) + "\n"


WRITTEN = {
    "job": job_reference,
    "build_job": lambda: job_reference(BuildJob, BUILD_HEAD),
    "columns": column_reference,
    "commands": command_reference,
    "performance": performance_reference,
}
"""What writes each generated page."""


if __name__ == "__main__":
    for name, write in WRITTEN.items():
        (DOCS / f"{name}.md").write_text(write())
        print(DOCS / f"{name}.md")
