"""`splatreasoner report`: a run as a page to look at."""

from __future__ import annotations

from typing import Annotated

import typer


def report(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    overlays: Annotated[
        int, typer.Option(min=0, help="Questions whose clusters and groundings are drawn; 0 draws none.")
    ] = 24,
    seconds: Annotated[float, typer.Option(min=0, help="No picture is begun after so long.")] = 120.0,
    scenes: Annotated[str, typer.Option(help="Folder with the scenes, where they are not where the plan says.")] = "",
) -> None:
    """Write report.html into a run: scores, and for every question what led to its answer.

    Its data lie in the folder report/ beside it: keep both together. Questions with overlays are some of each outcome.

    Examples: [bold]splatreasoner report demo/run[/bold]

    [bold]splatreasoner report runs/scannet --overlays 500 --seconds 1800 --scenes data/scenes[/bold]
    """
    from jobs.report import write_report
    from jobs.report.pictures import DrawingBudget
    from jobs.runs.progress import for_terminal, on_terminal

    drawing = DrawingBudget(overlays, seconds, scenes)
    writing = on_terminal("questions written")
    print(write_report(run, drawing=drawing, progress=for_terminal("questions drawn"), writing=writing))
