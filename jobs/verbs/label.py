"""`splatreasoner label`: ground truth, or what a detector sees, onto a scene of one's own."""

from __future__ import annotations

import os
from typing import Annotated

import typer


def label(
    scene: Annotated[str, typer.Argument(help="Scene folder, a path or URI.")],
    output: Annotated[str, typer.Option(help="Folder of the new scene.")],
    source: Annotated[
        str | None, typer.Option("--from", help="Folder of a ScanNet scan, or an .npz of points with labels.")
    ] = None,
    semantics: Annotated[
        str | None,
        typer.Option(help="In place of --from, what names things in its views: ssd_mobilenet, label_files:FOLDER, ..."),
    ] = None,
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
    With --semantics, categories come from what a detector or label images say of the scene's views instead: of their
    photographs, or of renders where there are none.

    Examples: [bold]splatreasoner label scenes/mine --from scans/scene0000_00 --output scenes/labelled[/bold]

    [bold]splatreasoner label scenes/mine --semantics ssd_mobilenet --output scenes/named[/bold]
    """
    from pydantic import ValidationError

    from jobs.scenes.label import label_scene
    from pipeline.construct.distillation.distill import DistillConfig
    from schemas.errors import InputError

    cores = threads or len(os.sched_getaffinity(0))
    if (source is None) == (semantics is None):
        raise InputError("label", expected="one of --from and --semantics", found="both or neither")
    if semantics is not None:
        _describe(scene, semantics, output, cores)
        return
    assert source is not None
    try:
        config = DistillConfig(reach=reach, most=most, farthest=farthest)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"--{first['loc'][0]}", expected=first["msg"], found=first["input"]) from error
    made = label_scene(scene, source, output, config, keep_categories=keep_categories, threads=cores)
    for line in made.warnings:
        print(f"warning: {line}")
    print(
        f"{made.uri}: {made.gaussians:,} Gaussians, {made.labelled:.1%} labelled, {made.instances} instances; "
        f"mean purity {made.purity:.3f}, {made.near:.1%} within 3 sigma of a point"
    )


def _describe(scene: str, semantics: str, output: str, threads: int) -> None:
    from jobs.runs.progress import for_terminal
    from jobs.scenes.describe import describe_scene
    from pipeline.construct.semantics.describe import SemanticsConfig
    from pipeline.construct.semantics.labels_2d.choose import source_from_text

    shown, begun = for_terminal("views"), False

    def tell(done: int, total: int) -> None:
        nonlocal begun
        if not begun:
            shown.begin(total, 0)
            begun = True
        shown.advance("")

    try:
        config = SemanticsConfig(source=source_from_text(semantics))
        made = describe_scene(scene, config, output, threads=threads, progress=tell)
    finally:
        shown.end()
    for line in made.warnings:
        print(line)
    print(
        f"{made.uri}: {made.gaussians:,} Gaussians, {made.labelled:.1%} labelled, {made.categories} categories, "
        f"seen on {made.photographs} photographs and {made.rendered} renders"
    )
