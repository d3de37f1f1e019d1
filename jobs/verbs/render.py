"""`splatreasoner render`: pictures of a scene from its cameras and from above, and of what a run found there."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schemas.errors import InputError


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
    from_above: Annotated[
        bool, typer.Option("--map", help="Write map.png instead: the scene from above, with the cameras' path.")
    ] = False,
    run: Annotated[str, typer.Option(help="Run folder, a path or URI, for --question.")] = "",
    question: Annotated[
        str, typer.Option(help="Draw a question's views, clusters and groundings instead, and on the map.")
    ] = "",
    threads: Annotated[int, typer.Option(help="Threads a picture.", min=1)] = 1,
) -> None:
    """Render recorded views: PNG pictures to look at, and the exact arrays as NPZ.

    Examples: [bold]splatreasoner render demo/scenes/apartment-101 --camera 00010 --outputs color,depth
    --output pictures[/bold]

    [bold]splatreasoner render demo/scenes/apartment-101 --map --run demo/run --question apartment-101-multi-target-003
    --output pictures[/bold]
    """
    if bool(run) != bool(question):
        raise InputError("--run and --question", expected="both or neither", found=f"only {run or question}")
    if not (from_above or question):
        from jobs.pictures import render_views

        names, kinds = camera or [], outputs.split(",")
        written = render_views(scene, output, names, kinds, every=every, sheet=sheet, threads=threads)
    elif camera:
        raise InputError("--camera", expected="no --map and no --question beside it", found=", ".join(camera))
    else:
        from jobs.drawing.question_files import draw_files

        written = draw_files(
            scene, output, run=run, question_id=question, on_map=from_above, sheet=sheet, threads=threads
        )
    print(f"{len(written)} file{'' if len(written) == 1 else 's'} in {output}")
