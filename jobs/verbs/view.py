"""`splatreasoner view`: a scene, and what a run found in it, in a browser."""

from __future__ import annotations

from typing import Annotated

import typer

from schemas.errors import InputError


def view(
    scene: Annotated[str, typer.Argument(help="Scene folder, a path or URI.")],
    run: Annotated[str, typer.Option(help="Run folder, a path or URI, whose questions can be chosen.")] = "",
    question: Annotated[str, typer.Option(help="Id of the question to begin with.")] = "",
    host: Annotated[
        str, typer.Option(help="Address to listen at; 0.0.0.0 shows the scene to everybody who reaches this machine.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 8080,
    max_gaussians: Annotated[
        int, typer.Option(min=1, help="Gaussians drawn at most: those that cover most; fewer suit a slow machine.")
    ] = 1_000_000,
    dark: Annotated[bool, typer.Option(help="Begin dark.")] = False,
    threads: Annotated[int, typer.Option(help="Threads a picture.", min=1)] = 1,
) -> None:
    """Walk through a scene in a browser: splats, cameras, and a question's clusters, views and groundings.

    Needs the extra view. Ctrl-C ends it.

    Examples: [bold]splatreasoner view demo/scenes/apartment-101[/bold]

    [bold]splatreasoner view demo/scenes/apartment-101 --run demo/run --question apartment-101-multi-target-003[/bold]
    """
    import signal
    import sys
    import threading
    from functools import partial

    if question and not run:
        raise InputError("--question", expected="--run beside it", found="none")
    from jobs.viewer.server import Viewer, ViewerOptions

    options = ViewerOptions(host, port, max_gaussians, dark, threads)
    tell = partial(print, file=sys.stderr)
    with Viewer(scene, run=run, question_id=question, options=options, tell=tell) as viewer:
        stopped = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopped.set())
        print(f"{viewer.url} shows {scene}; Ctrl-C ends it", flush=True)
        stopped.wait()
    print("ended")
