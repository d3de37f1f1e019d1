"""`splatreasoner curate`: a referring segmentation set."""

from __future__ import annotations

from typing import Annotated

import typer


def curate(
    scenes: Annotated[list[str], typer.Argument(help="Scene folders with objects.json, paths, URIs or patterns.")],
    output: Annotated[str, typer.Option(help="JSONL file to write, a path or URI.")],
    count: Annotated[int, typer.Option(help="Most questions (paper: 49).", min=1)] = 49,
    distractors: Annotated[int, typer.Option(help="Fewest other objects of the target's category.", min=1)] = 1,
    seed: Annotated[int, typer.Option(help="Fixes every choice.", min=0)] = 0,
) -> None:
    """Make questions that single out one of several like things, for `dataset: {kind: referring}` of a job.

    Example: [bold]splatreasoner curate scenes/* --output referring.jsonl --count 49 --seed 0[/bold]
    """
    from jobs.scenes.curate import curate_scenes

    made = curate_scenes(scenes, output, count=count, least_distractors=distractors, seed=seed)
    print(f"{output}: {made.summary}")
    if len(made.questions) < count:
        print(f"{len(made.questions)} of {count}: the scenes have no more that can be told apart in words")
