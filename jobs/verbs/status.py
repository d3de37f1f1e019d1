"""`splatreasoner status`: how far a run is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from jobs.runs.failures import Failure
    from jobs.runs.status import RunStatus

FAILURES_SHOWN = 12
"""Errors told, the most frequent; --json gives all."""
MESSAGE_WIDTH = 160
CLEAR = "\x1b[2J\x1b[H"
"""What empties a terminal."""


def status(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    watch: Annotated[bool, typer.Option("--watch", help="Say it again until the run is complete.")] = False,
    every: Annotated[float, typer.Option(help="Seconds between looks of --watch.", min=0.5)] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object; with --watch one a line.")] = False,
) -> None:
    """Say how far a run is: units, questions, rate, time left, spend, failures by error.

    Example: [bold]splatreasoner status demo/run --watch[/bold]
    """
    import sys
    import time

    from jobs.runs.failures import FailedRows
    from jobs.runs.status import run_status

    rows = FailedRows(run)
    while True:
        found = run_status(run, rows)
        if as_json:
            import json

            print(json.dumps(found.as_json(), indent=None if watch else 1), flush=True)
        else:
            if watch and sys.stdout.isatty():
                print(CLEAR, end="")
            print("\n".join(lines(found, run)), flush=True)
        if not watch or found.complete:
            return
        try:
            time.sleep(every)
        except KeyboardInterrupt:
            return


def lines(found: RunStatus, run: str) -> list[str]:
    """Return a status for people, line by line."""
    state = "complete" if found.complete else "running" if found.running else "not running"
    told = [f"{found.name}: {state}", f"units: {found.units_done} of {found.units} committed"]
    told.append(f"{found.items}: {found.questions_done} of {found.questions} committed")
    told += [f"  {name}: {count}" for name, count in found.statuses.items()]
    if found.driver and not found.complete:
        quiet = "" if found.quiet_s is None else f", last word {_minutes(found.quiet_s / 60)} ago"
        told.append(f"{'driver' if found.running else 'last driver'}: {found.driver} (session {found.session}){quiet}")
    if found.per_minute is not None:
        recent = "" if found.recent_per_minute is None else f", lately {found.recent_per_minute:.1f}"
        told.append(f"rate: {found.per_minute:.1f} {found.items} a minute in the latest session{recent}")
        if not found.complete and found.minutes_left is not None:
            told.append(f"time left at that rate: {_minutes(found.minutes_left)}")
    told += [f"  {line}" for line in found.at_work]
    told += _spend(found) if found.items == "questions" else []
    if found.retries:
        by_error = ", ".join(f"{error} {count}" for error, count in found.retries.items())
        told.append(f"tries beyond the first: {sum(found.retries.values())} ({by_error})")
    told += [f"  {failure_line(failure, found.items)}" for failure in found.failures[:FAILURES_SHOWN]]
    if len(found.failures) > FAILURES_SHOWN:
        told.append(f"  and {len(found.failures) - FAILURES_SHOWN} other errors: status --json lists all")
    if not found.complete and not found.running:
        told.append(f"go on with: splatreasoner resume {run}")
    elif found.complete and found.statuses.get("failed"):
        told.append(f"do failed ones again with: splatreasoner retry {run} --status failed")
    return told


def failure_line(failure: Failure, items: str) -> str:
    """Return failed questions, or captures, of one error in a line, with what one of them says."""
    message = " ".join(failure.message.split())
    message = message if len(message) <= MESSAGE_WIDTH else message[: MESSAGE_WIDTH - 1] + "…"
    said = ": ".join(filter(None, (failure.error, message)))
    return f"{failure.questions} failed: {said}" + (
        f" (such as {items[:-1]} {failure.example})" if failure.example else ""
    )


def _spend(found: RunStatus) -> list[str]:
    told = []
    if found.calls is not None:
        money = "" if found.calls.usd is None else f", {found.calls.usd:.4f} USD"
        told.append(
            f"calls of committed units: {found.calls.calls:,}, {found.calls.cached:,} of them stored replies; "
            f"{found.calls.tokens:,} tokens sent{money}; {found.calls.failed_tries:,} failed tries"
        )
    if found.paid is not None:
        told.append(
            f"sent to endpoints in all sessions: {found.paid.calls:,} calls, {found.paid.tokens:,} tokens, "
            f"{found.paid.usd:.4f} USD"
        )
    return told


def _minutes(minutes: float) -> str:
    if minutes < 2:
        return f"{60 * minutes:.0f} s"
    return f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.1f} h"
