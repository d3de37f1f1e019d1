"""`splatreasoner plan`: what a job will take, before anything is spent."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer


def plan(
    job: Annotated[Path, typer.Argument(help="Job file, YAML.", metavar="JOB.yaml")],
    sample: Annotated[int, typer.Option(help="Questions to try, with no model asked.", min=1)] = 60,
    seconds_a_call: Annotated[float, typer.Option(help="Latency of a model call, seconds.", min=0)] = 2.0,
) -> None:
    """Say what a job will take: units, calls by stage, tokens, money and time. Nothing is sent.

    Example: [bold]splatreasoner plan job.yaml[/bold]
    """
    from jobs.config import load_job
    from jobs.forecast import forecast
    from jobs.progress import for_terminal

    config, shown = load_job(job), for_terminal()
    cpus = 1 if config.workers.in_process else config.workers.cpus or len(os.sched_getaffinity(0))
    try:
        found = forecast(config, subject=job, sample=sample, cpus=cpus, seconds_a_call=seconds_a_call, progress=shown)
    finally:
        shown.end()
    print(f"{found.scenes} scenes, {found.questions} questions, {found.units} units; {found.sampled} questions tried")
    print(f"{'stage':<12}{'endpoint':<14}{'calls':>10}{'tokens in':>14}{'tokens out':>12}{'USD':>10}")
    for stage in found.stages:
        usd = "?" if stage.usd is None else f"{stage.usd:.2f}"
        print(
            f"{stage.stage:<12}{stage.endpoint[:13]:<14}{stage.calls:>10,.0f}{stage.prompt_tokens:>14,.0f}"
            f"{stage.completion_tokens:>12,.0f}{usd:>10}"
        )
    sums = [
        sum(getattr(stage, name) for stage in found.stages) for name in ("calls", "prompt_tokens", "completion_tokens")
    ]
    prices = [stage.usd for stage in found.stages]
    usd = "?" if None in prices else f"{sum(price for price in prices if price is not None):.2f}"
    print(f"{'all':<26}{sums[0]:>10,.0f}{sums[1]:>14,.0f}{sums[2]:>12,.0f}{usd:>10}")
    print(f"rendering and clustering: {found.cpu_s / 60:.1f} min on {cpus} CPU slots")
    for name, seconds in found.model_s.items():
        print(f"calls to {name}: {seconds / 60:.1f} min by its limits, at {seconds_a_call:g} s a call")
