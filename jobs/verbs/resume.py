"""`splatreasoner resume`: do what a run still lacks."""

from __future__ import annotations

from typing import Annotated, Any

import typer


def resume(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    cpus: Annotated[int | None, typer.Option(help="CPU slots of a local Ray, in place of the job's.", min=1)] = None,
    address: Annotated[str | None, typer.Option(help="Ray cluster, in place of the job's.")] = None,
    in_process: Annotated[
        bool | None, typer.Option("--in-process/--on-ray", help="Run here or on Ray, in place of the job's.")
    ] = None,
) -> None:
    """Answer the questions of a run that are not committed yet; nothing else than its folder is needed.

    Example: [bold]splatreasoner resume demo/run[/bold]
    """
    from jobs.progress import for_terminal
    from jobs.submit import resume
    from jobs.verbs.ending import end

    given: dict[str, Any] = {"cpus": cpus, "address": address, "in_process": in_process}
    workers = {name: value for name, value in given.items() if value is not None}
    end(resume(run, progress=for_terminal(), workers=workers))
