"""`splatreasoner check`: what a scene folder holds, what is missing, what is wrong."""

from __future__ import annotations

from typing import Annotated

import typer

BAD_INPUT = 2


def check(scene: Annotated[str, typer.Argument(help="Scene folder, a path or URI.")]) -> None:
    """Say what a scene holds, what is missing and what is wrong; exit with 2 when it cannot be used.

    Example: [bold]splatreasoner check demo/scenes/apartment-101[/bold]
    """
    from pipeline.scene.check import check_scene

    report = check_scene(scene)
    for line in report.lines():
        print(line)
    if not report.usable:
        raise typer.Exit(BAD_INPUT)
