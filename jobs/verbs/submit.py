"""`splatreasoner submit`: plan a job file and run it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def submit(
    job: Annotated[Path, typer.Argument(help="Job file, YAML.", metavar="JOB.yaml")],
    output: Annotated[
        str | None, typer.Option(help="Run folder in place of the job's; stored replies stay where the job keeps them.")
    ] = None,
    address: Annotated[str | None, typer.Option(help="Ray cluster, such as auto, in place of the job's.")] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Neither use nor keep stored replies.")] = False,
    replay: Annotated[bool, typer.Option("--replay", help="Use stored replies only; send nothing.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what it will take, as plan does; spend nothing.")
    ] = False,
    plain: Annotated[bool, typer.Option("--plain", help="Plain lines off a terminal, in place of JSON.")] = False,
    log_json: Annotated[bool, typer.Option("--log-json", help="JSON lines also on a terminal.")] = False,
) -> None:
    """Plan a job and answer its questions; a run that was begun before goes on where it ended.

    Example: [bold]splatreasoner submit job.yaml[/bold]
    """
    from jobs.config import load_job
    from jobs.runs.progress import for_terminal, progress_style
    from jobs.runs.submit import in_another_folder, submit
    from jobs.verbs.ending import cache_mode, end

    config, cache = load_job(job), cache_mode(no_cache, replay)
    if output is not None:
        config = in_another_folder(config, output)
    if address is not None:
        workers = config.workers.model_copy(update={"address": address, "in_process": False})
        config = config.model_copy(update={"workers": workers})
    if cache is not None:
        config = config.model_copy(update={"cache": cache})
    if dry_run:
        from jobs.verbs.plan import say_plan

        say_plan(config, job)
        return
    end(submit(config, subject=job, progress=for_terminal(style=progress_style(plain, log_json))))
