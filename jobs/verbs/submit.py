"""`splatreasoner submit`: plan a job file and run it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def submit(
    job: Annotated[Path, typer.Argument(help="Job file, YAML.", metavar="JOB.yaml")],
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Neither use nor keep stored replies.")] = False,
    replay: Annotated[bool, typer.Option("--replay", help="Use stored replies only; send nothing.")] = False,
) -> None:
    """Plan a job and answer its questions; a run that was begun before goes on where it ended.

    Example: [bold]splatreasoner submit job.yaml[/bold]
    """
    from jobs.config import load_job
    from jobs.progress import for_terminal
    from jobs.submit import submit
    from jobs.verbs.ending import cache_mode, end

    config, cache = load_job(job), cache_mode(no_cache, replay)
    if cache is not None:
        config = config.model_copy(update={"cache": cache})
    end(submit(config, subject=job, progress=for_terminal()))
