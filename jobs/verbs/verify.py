"""`splatreasoner verify`: read everything a run holds and say what is damaged."""

from __future__ import annotations

from typing import Annotated

import typer


def verify(
    run: Annotated[str, typer.Argument(help="Run folder, a path or URI.")],
    calls: Annotated[bool, typer.Option("--calls", help="Also read the stored model replies.")] = False,
    clean: Annotated[
        bool, typer.Option("--clean", help="Remove files that no manifest names; no driver may be at work.")
    ] = False,
) -> None:
    """Read every manifest, part and row of a run and compare them with hashes and plan; exit 1 when one is wrong.

    Example: [bold]splatreasoner verify demo/run[/bold]
    """
    from jobs.runs.verify import verify_run

    found = verify_run(run, calls=calls, clean=clean)
    print(f"{found.items}: {found.questions} of {found.planned} committed, whole and right, in {found.units} units")
    print(f"read: {found.rows} rows, {found.nbytes / 1e6:.1f} MB of parts")
    if found.replies is not None:
        print(f"stored replies: {found.replies}")
    if found.discarded:
        print(f"commits taken back, to be done again: {found.discarded}")
    if found.orphans:
        print(
            f"files that count for nothing: {len(found.orphans)}{', removed' if clean else ' (--clean removes them)'}"
        )
    for problem in found.problems:
        print(f"  damaged: {problem}")
    if found.problems:
        print(f"{len(found.problems)} damaged; parts and manifests are done again by: splatreasoner resume {run}")
        raise typer.Exit(1)
    print("nothing is damaged")
