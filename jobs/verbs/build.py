"""`splatreasoner build`: scenes from a ScanNet scan, or generated ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schemas.errors import InputError


def build(
    output: Annotated[Path, typer.Option(help="Folder of the new scene.")],
    scannet_mesh: Annotated[
        Path | None, typer.Option(help="Folder of a ScanNet scan: mesh with labels, segments, aggregation.")
    ] = None,
    procedural: Annotated[int | None, typer.Option(help="Seed of a generated apartment.", min=0)] = None,
    gaussians: Annotated[int, typer.Option(help="Gaussians of a generated apartment.", min=1000)] = 80_000,
    rooms: Annotated[int, typer.Option(help="Rooms of a generated apartment.", min=1)] = 4,
    views: Annotated[int, typer.Option(help="Views on the camera path.", min=1)] = 120,
    seed: Annotated[int, typer.Option(help="Seed of the questions about a scan.", min=0)] = 0,
) -> None:
    """Build a scene folder with cameras, categories, instances and questions.

    Examples: [bold]splatreasoner build --procedural 7 --output scenes/apartment-7[/bold]

    [bold]splatreasoner build --scannet-mesh scans/scene0000_00 --output scenes/scene0000_00[/bold]
    """
    from jobs.build import build_procedural, build_scan

    if (scannet_mesh is None) == (procedural is None):
        raise InputError("build", expected="one of --scannet-mesh and --procedural", found="both or neither")
    if procedural is not None:
        built = build_procedural(procedural, str(output), gaussians=gaussians, rooms=rooms, views=views)
    else:
        assert scannet_mesh is not None
        built = build_scan(scannet_mesh, str(output), views=views, seed=seed)
    print(
        f"{built.uri}: {built.gaussians:,} Gaussians, {built.views} views, {built.objects} objects, "
        f"{built.questions} questions"
    )
