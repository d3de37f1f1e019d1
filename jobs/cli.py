"""The command line. Exit codes: 0 done, 1 failed, 2 bad input, 130 stopped by a signal."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Annotated

import typer

from jobs.verbs import (
    aggregate,
    build,
    cache,
    check,
    compare,
    curate,
    demo,
    export,
    index,
    label,
    plan,
    render,
    report,
    resume,
    retry,
    status,
    submit,
    table,
    verify,
    view,
)
from schemas.errors import InputError, SplatReasonerError

app = typer.Typer(
    name="splatreasoner",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

VERBS: dict[str, Callable[..., None]] = {
    "demo": demo.demo,
    "build": build.build,
    "label": label.label,
    "curate": curate.curate,
    "check": check.check,
    "render": render.render,
    "index": index.index,
    "plan": plan.plan,
    "submit": submit.submit,
    "resume": resume.resume,
    "status": status.status,
    "retry": retry.retry,
    "verify": verify.verify,
    "cache": cache.cache,
    "aggregate": aggregate.aggregate,
    "compare": compare.compare,
    "export": export.export,
    "table": table.table,
    "report": report.report,
    "view": view.view,
}
"""Verbs in the order in which a person meets them."""


def _say_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"splatreasoner {version('splatreasoner')}")
        raise typer.Exit


@app.callback()
def splatreasoner(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Say the version and stop.")
    ] = False,
) -> None:
    """Batch question answering and 3D grounding over Gaussian Splatting scenes.

    The ten-minute start: [bold]splatreasoner demo[/bold]
    """


for _name, _verb in VERBS.items():
    app.command(_name)(_verb)


def main() -> None:
    """Run the command line; errors raised on purpose become one line each and an exit code."""
    try:
        app()
    except InputError as error:
        _tell(error)
        sys.exit(2)
    except SplatReasonerError as error:
        _tell(error)
        sys.exit(1)


def _tell(error: SplatReasonerError) -> None:
    for line in (str(error), *getattr(error, "__notes__", ())):
        print(f"error: {line}", file=sys.stderr)
