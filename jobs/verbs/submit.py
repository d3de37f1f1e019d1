"""`splatreasoner submit`: plan a job file and run it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def submit(job: Annotated[Path, typer.Argument(help="Job file, YAML.", metavar="JOB.yaml")]) -> None:
    """Plan a job and answer its questions; a run that was begun before goes on where it ended.

    Example: [bold]splatreasoner submit job.yaml[/bold]
    """
    from jobs.config import load_job
    from jobs.progress import for_terminal
    from jobs.submit import submit
    from jobs.verbs.ending import end

    end(submit(load_job(job), subject=job, progress=for_terminal()))
