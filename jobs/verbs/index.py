"""`splatreasoner index`: the visibility index of a scene, built ahead of its runs."""

from __future__ import annotations

import os
from typing import Annotated

import typer


def index(
    scene: Annotated[str, typer.Argument(help="Scene folder, a path or URI.")],
    output: Annotated[
        str, typer.Option(help="Folder of the index, a path or URI; jobs name it as their field visibility.")
    ] = "visibility",
    threads: Annotated[
        int | None, typer.Option(help="Views rendered side by side; every core of this machine by default.", min=1)
    ] = None,
    long_side: Annotated[
        int | None, typer.Option(help="Longest image side of the renders, pixels, as in the job.", min=1)
    ] = None,
    near: Annotated[float, typer.Option(help="Near plane of the renders, metres, as in the job.", min=1e-3)] = 0.2,
) -> None:
    """Render which Gaussians each recorded view shows, and store it; views that are stored are not rendered again.

    Example: [bold]splatreasoner index demo/scenes/apartment-101 --output demo/visibility[/bold]
    """
    from jobs.runs.progress import for_terminal
    from jobs.scenes.index import build_index
    from pipeline.query.visibility import VisibilityConfig

    config = VisibilityConfig(long_side=long_side, near_m=near)
    shown = for_terminal("views")
    try:
        cores = threads or len(os.sched_getaffinity(0))
        built = build_index(scene, output, config, threads=cores, progress=shown)
    finally:
        shown.end()
    print(f"{built.folder}: {built.views} views, {built.stored} were stored, {built.rendered} rendered")
    if built.rendered:
        print(f"{built.seconds / built.rendered:.3f} s a view, {built.seconds:.1f} s in all")
    print(f"{built.nbytes / max(built.views, 1) / 1e3:.1f} kB a view, {built.nbytes / 1e6:.1f} MB in all")
