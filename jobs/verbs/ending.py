"""How `submit` and `resume` end: a line on what there is now, and the exit code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from jobs.signals import STOPPED
from schemas.errors import InputError

if TYPE_CHECKING:
    from jobs.submit import RunResult

FAILED = 1
REASONS = 3
"""Reasons of failed questions that are told; the others stand in events.jsonl and in the tables."""


def cache_mode(no_cache: bool, replay: bool) -> str | None:
    """Return what two flags say about stored replies; None when they say nothing.

    Raises:
        InputError: They contradict each other.
    """
    if no_cache and replay:
        raise InputError("--no-cache", expected="one of --no-cache and --replay", found="both")
    return "off" if no_cache else "replay" if replay else None


def end(result: RunResult) -> None:
    """Print how far a run is and what to do next.

    Raises:
        typer.Exit: The run was stopped, or every question of the session failed.
    """
    from jobs.status import run_status

    driven, status = result.driven, run_status(result.run)
    counts = ", ".join(f"{count} {name}" for name, count in sorted(status.statuses.items()))
    print(f"{result.run}: {driven.done} of {driven.planned} questions committed" + (f" ({counts})" if counts else ""))
    for reason, count in list(status.reasons.items())[:REASONS]:
        print(f"  {count} failed: {reason}")
    if driven.stopped:
        print(f"stopped; go on with: splatreasoner resume {result.run}")
        raise typer.Exit(STOPPED)
    if status.statuses.get("failed", 0) == driven.planned:
        print("every question failed")
        raise typer.Exit(FAILED)
    print(f"scores: splatreasoner aggregate {result.run}; page: splatreasoner report {result.run}")
