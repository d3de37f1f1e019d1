"""`splatreasoner render`: pictures of a scene from its recorded cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def render(
    scene: Annotated[str, typer.Argument(help="Scene folder, a path or URI.")],
    output: Annotated[Path, typer.Option(help="Folder for the pictures.")],
    camera: Annotated[
        list[str] | None, typer.Option(help="Name of a recorded view; may be given again. Without it: every view.")
    ] = None,
    outputs: Annotated[
        str, typer.Option(help="What to write, with commas: color, depth, alpha, dominant, category.")
    ] = "color",
    every: Annotated[int, typer.Option(help="Take every n-th view.", min=1)] = 1,
    sheet: Annotated[bool, typer.Option(help="Also put all colour pictures on one contact sheet.")] = False,
    threads: Annotated[int, typer.Option(help="Threads a picture.", min=1)] = 1,
) -> None:
    """Render recorded views: PNG pictures to look at, and the exact arrays as NPZ.

    Example: [bold]splatreasoner render demo/scenes/apartment-101 --camera 00010 --outputs color,depth
    --output pictures[/bold]
    """
    from jobs.pictures import render_views

    written = render_views(scene, output, camera or [], outputs.split(","), every=every, sheet=sheet, threads=threads)
    print(f"{len(written)} files in {output}")
