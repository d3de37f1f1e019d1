"""`splatreasoner plan`: what a job will take, before anything is spent."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from jobs.config import JobConfig
    from jobs.forecast import Forecast


def plan(
    job: Annotated[Path, typer.Argument(help="Job file, YAML.", metavar="JOB.yaml")],
    sample: Annotated[
        int | None,
        typer.Option(help="Questions to try, with no model asked; as many as it takes if left out.", min=1),
    ] = None,
    seconds_a_call: Annotated[float, typer.Option(help="Latency of a model call, seconds.", min=0)] = 2.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="No other way: a plan never spends anything.")] = True,
) -> None:
    """Say what a job will take: units, renders, calls by stage, tokens, money and time. Nothing is sent.

    Example: [bold]splatreasoner plan job.yaml[/bold]
    """
    from jobs.config import load_job

    say_plan(load_job(job), job, sample, seconds_a_call)


def say_plan(config: JobConfig, job: Path, sample: int | None = None, seconds_a_call: float = 2.0) -> None:
    """Print what a job will take; `submit --dry-run` does nothing else.

    Raises:
        InputError: The job or a question file is wrong, or no scene can be used.
    """
    from jobs.forecast import forecast
    from jobs.runs.progress import for_terminal

    shown = for_terminal()
    cpus = 1 if config.workers.in_process else config.workers.cpus or len(os.sched_getaffinity(0))
    try:
        found = forecast(config, subject=job, sample=sample, cpus=cpus, seconds_a_call=seconds_a_call, progress=shown)
    finally:
        shown.end()
    for line in _lines(found, cpus, seconds_a_call):
        print(line)


def _lines(found: Forecast, cpus: int, seconds_a_call: float) -> list[str]:
    lines = [
        f"{found.scenes} scenes, {found.questions} questions, {found.units} units; {found.sampled} questions tried",
        f"to render: {found.pictures:,.0f} pictures for the models, at most {found.maps:,.0f} dominance maps "
        f"({found.maps_made:,} made now and stored)",
        f"{'stage':<12}{'endpoint':<14}{'calls':>10}{'tokens in':>14}{'tokens out':>12}{'USD':>10}{'+-':>6}",
    ]
    for stage in found.stages:
        lines.append(
            f"{stage.stage:<12}{stage.endpoint[:13]:<14}{stage.calls:>10,.0f}{stage.prompt_tokens:>14,.0f}"
            f"{stage.completion_tokens:>12,.0f}{_usd(stage.usd):>10}{stage.margin:>6.0%}"
        )
    calls, tokens_in, tokens_out = (
        sum(getattr(stage, name) for stage in found.stages) for name in ("calls", "prompt_tokens", "completion_tokens")
    )
    prices = [stage.usd for stage in found.stages]
    usd = None if None in prices else sum(price for price in prices if price is not None)
    lines.append(
        f"{'all':<26}{calls:>10,.0f}{tokens_in:>14,.0f}{tokens_out:>12,.0f}{_usd(usd):>10}{found.margin:>6.0%}"
    )
    lines.append(f"time: {_minutes(found.seconds)}, the longest of what overlaps:")
    lines.append(f"  rendering and clustering: {_minutes(found.cpu_s)} on {cpus} CPU slots like this one")
    for name, seconds in found.model_s.items():
        lines.append(f"  calls to {name}: {_minutes(seconds)} by its limits, at {seconds_a_call:g} s a call")
    if found.model_s:
        lines.append(f"  questions in flight waiting for replies: {_minutes(found.waiting_s)}")
    return [*lines, *(f"note: {note}" for note in found.notes)]


def _usd(price: float | None) -> str:
    return "?" if price is None else f"{price:.2f}"


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.1f} min"
