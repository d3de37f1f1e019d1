"""`splatreasoner label`: ground truth onto a scene of one's own."""

from __future__ import annotations

import os
from typing import Annotated

import typer


def label(
    scene: Annotated[str, typer.Argument(help="Scene folder, a path or URI.")],
    source: Annotated[str, typer.Option("--from", help="Folder of a ScanNet scan, or an .npz of points with labels.")],
    output: Annotated[str, typer.Option(help="Folder of the new scene.")],
    keep_categories: Annotated[
        bool, typer.Option("--keep-categories", help="Leave the scene's own categories; add instances only.")
    ] = False,
    reach: Annotated[float, typer.Option(help="Points count within this many times the largest scale.")] = 5.0,
    most: Annotated[int, typer.Option(help="Nearest points that count.")] = 1000,
    farthest: Annotated[
        float | None, typer.Option(help="Farthest Mahalanobis distance of the nearest point; any by default.")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="Every core of this machine by default.", min=1)] = None,
) -> None:
    """Copy a scene with categories and instances voted onto its Gaussians by labelled points near them.

    Scene and points must share coordinates; a ScanNet scan's are those of its poses and mesh (not axis-aligned).

    Example: [bold]splatreasoner label scenes/mine --from scans/scene0000_00 --output scenes/labelled[/bold]
    """
    from pydantic import ValidationError

    from jobs.label import label_scene
    from pipeline.construct.distill import DistillConfig
    from schemas.errors import InputError

    try:
        config = DistillConfig(reach=reach, most=most, farthest=farthest)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"--{first['loc'][0]}", expected=first["msg"], found=first["input"]) from error
    cores = threads or len(os.sched_getaffinity(0))
    made = label_scene(scene, source, output, config, keep_categories=keep_categories, threads=cores)
    for line in made.warnings:
        print(f"warning: {line}")
    print(
        f"{made.uri}: {made.gaussians:,} Gaussians, {made.labelled:.1%} labelled, {made.instances} instances; "
        f"mean purity {made.purity:.3f}, {made.near:.1%} within 3 sigma of a point"
    )
