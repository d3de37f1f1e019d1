"""`splatreasoner demo`: the whole pipeline on generated scenes, offline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    output: Annotated[Path, typer.Option(help="Folder for scenes and run.")] = Path("demo"),
    scenes: Annotated[int, typer.Option(help="Apartments to generate.", min=1)] = 3,
    fresh: Annotated[bool, typer.Option(help="Start over: generate and answer everything anew.")] = False,
    in_process: Annotated[bool, typer.Option(help="Without Ray.")] = False,
) -> None:
    """Generate apartments, answer questions about them with the offline symbolic model, print the ablation.

    A demo that was interrupted goes on where it ended.

    Example: [bold]splatreasoner demo[/bold]
    """
    from jobs.demo import run_demo
    from jobs.verbs.ending import end

    result = run_demo(output, scenes=scenes, fresh=fresh, in_process=in_process)
    if result.driven.complete:
        from jobs.report import write_report
        from jobs.verbs.aggregate import show

        show(result.run)
        print(f"report: {write_report(result.run)}")
    end(result)
