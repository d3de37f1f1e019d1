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
    max_calls: Annotated[int | None, typer.Option(help="Most model calls of the whole run.", min=0)] = None,
    max_tokens: Annotated[int | None, typer.Option(help="Most tokens of the whole run.", min=0)] = None,
    max_usd: Annotated[float | None, typer.Option(help="Most money of the whole run, US dollars.", min=0)] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Neither use nor keep stored replies.")] = False,
    replay: Annotated[bool, typer.Option("--replay", help="Use stored replies only; send nothing.")] = False,
    plain: Annotated[bool, typer.Option("--plain", help="Plain lines off a terminal, in place of JSON.")] = False,
    log_json: Annotated[bool, typer.Option("--log-json", help="JSON lines also on a terminal.")] = False,
) -> None:
    """Do what a run has not committed yet, questions or captures; nothing else than its folder is needed.

    Example: [bold]splatreasoner resume demo/run[/bold]
    """
    from jobs.runs.progress import for_terminal, progress_style
    from jobs.runs.submit import resume
    from jobs.verbs.ending import cache_mode, end, end_build
    from schemas.run_folder import RunFolder

    given: dict[str, Any] = {"cpus": cpus, "address": address, "in_process": in_process}
    if address is not None and in_process is None:
        given["in_process"] = False
    workers = {name: value for name, value in given.items() if value is not None}
    caps = {"calls": max_calls, "tokens": max_tokens, "usd": max_usd}
    budget = {name: value for name, value in caps.items() if value is not None}
    cache = cache_mode(no_cache, replay)
    if RunFolder(run).builds():
        from jobs.builds.build_captures import resume_build
        from schemas.errors import InputError

        if budget or cache:
            raise InputError(run, expected="options that a build run knows", found="some about model calls")
        shown = for_terminal("captures", progress_style(plain, log_json))
        end_build(resume_build(run, progress=shown, workers=workers))
        return
    end(
        resume(
            run,
            progress=for_terminal(style=progress_style(plain, log_json)),
            workers=workers,
            budget=budget,
            cache=cache,
        )
    )
