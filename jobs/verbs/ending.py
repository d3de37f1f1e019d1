"""How `submit`, `build` and `resume` end: a line on what there is now, and the exit code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from jobs.runs.signals import STOPPED
from schemas.errors import InputError

if TYPE_CHECKING:
    from jobs.runs.submit import RunResult
    from schemas.builds import BuildRow

FAILED = 1
REASONS = 3
"""Errors of failed questions that are told; `status` tells the others."""


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
    from jobs.runs.status import run_status
    from jobs.verbs.status import failure_line

    driven, status = result.driven, run_status(result.run)
    counts = ", ".join(f"{count} {name}" for name, count in sorted(status.statuses.items()))
    print(f"{result.run}: {driven.done} of {driven.planned} questions committed" + (f" ({counts})" if counts else ""))
    for failure in status.failures[:REASONS]:
        print(f"  {failure_line(failure, status.items)}")
    if driven.stopped:
        print(f"stopped; go on with: splatreasoner resume {result.run}")
        raise typer.Exit(STOPPED)
    if status.statuses.get("failed", 0) == driven.planned:
        print("every question failed")
        raise typer.Exit(FAILED)
    print(f"scores: splatreasoner aggregate {result.run}; page: splatreasoner report {result.run}")


def end_build(result: RunResult) -> None:
    """Print which scenes there are now and how good they are.

    Raises:
        typer.Exit: The run was stopped, or a capture could not be built.
    """
    from schemas.builds import BUILDS
    from schemas.run_folder import RunFolder

    driven, rows = (
        result.driven,
        [row for part in RunFolder(result.run).parts("builds") for row in BUILDS.to_rows(part)],
    )
    print(f"{result.run}: {driven.done} of {driven.planned} captures committed")
    built, failed = ([row for row in rows if row.status == status] for status in ("built", "failed"))
    for row in built:
        print(f"  {row.scene_uri}: {row.gaussians:,} Gaussians, {row.fitted} frames fitted{_measured(row)}")
        for warning in row.warnings:
            print(f"    {warning}")
    for row in failed:
        print(f"  {row.capture}: {row.reason}")
    if driven.stopped:
        print(f"stopped; go on with: splatreasoner resume {result.run}")
        raise typer.Exit(STOPPED)
    if failed:
        print(f"{len(failed)} not built; once mended: splatreasoner retry {result.run} --status failed, then resume")
        raise typer.Exit(FAILED)


def _measured(row: BuildRow) -> str:
    """Return what was measured on held-out frames, where there were any."""
    if not row.held_out:
        return ""
    told = []
    if row.psnr is not None and row.ssim is not None:
        fitted = "" if row.aligned_psnr is None else f" ({row.aligned_psnr:.2f} dB with their poses fitted)"
        told.append(f"PSNR {row.psnr:.2f} dB{fitted}, SSIM {row.ssim:.3f}")
    if row.depth_error_m is not None and row.depth_within_5cm is not None:
        told.append(f"depth off by {100 * row.depth_error_m:.1f} cm, {row.depth_within_5cm:.0%} within 5 cm")
    return f"; {row.held_out} held out: {', '.join(told)}"
