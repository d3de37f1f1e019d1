"""`splatreasoner cache`: what lies in a folder of stored model replies."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Action(StrEnum):
    """What to do with a folder of stored replies."""

    STATS = "stats"
    EXPORT = "export"
    VERIFY = "verify"


def cache(
    action: Annotated[Action, typer.Argument(help="stats counts, export writes Parquet, verify reads all.")],
    folder: Annotated[Path, typer.Argument(help="Folder of stored replies, such as calls/ in a run.")],
    output: Annotated[Path | None, typer.Argument(help="File for export, such as replies.parquet.")] = None,
) -> None:
    """Count, export or check stored model replies.

    Example: [bold]splatreasoner cache stats demo/run/calls[/bold]
    """
    from jobs.stored_replies import contents, export
    from schemas.errors import InputError

    if (action == Action.EXPORT) != (output is not None):
        expected = "a file to write" if action == Action.EXPORT else "no file: only export writes one"
        raise InputError(f"cache {action}", expected=expected, found=output or "none")
    if output is not None:
        print(f"{output}: {export(folder, output)} replies")
        return
    found = contents(folder)
    if action == Action.STATS:
        for (client, stage), count in found.counts.items():
            print(
                f"{client or '?'} {stage or '?'}: {count.replies} replies, {count.prompt_tokens} + "
                f"{count.completion_tokens} tokens, {count.nbytes / 1e6:.1f} MB"
            )
    replies = sum(count.replies for count in found.counts.values())
    print(f"{folder}: {replies} replies, {len(found.damaged)} damaged files")
    if action == Action.VERIFY:
        for path in found.damaged:
            print(f"  {path}")
        if found.damaged:
            raise typer.Exit(1)
