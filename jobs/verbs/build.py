"""`splatreasoner build`: scenes from captures, from a ScanNet scan, or generated ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schemas.errors import InputError

if TYPE_CHECKING:
    from jobs.builds.build_job import BuildJob

AS_LONG_AS_TIME_LASTS = 30_000
"""Steps where minutes alone are asked for: what 3DGS takes, and more than a CPU does in an hour."""


def build(
    output: Annotated[
        Path | None,
        typer.Option(help="Folder of the new scene; with captures the run folder, whose scenes/ gets a folder each."),
    ] = None,
    capture: Annotated[
        list[str] | None,
        typer.Option(
            help="Posed frames, with depth or sparse points: a folder or file, or a pattern; may be repeated."
        ),
    ] = None,
    job: Annotated[Path | None, typer.Option(help="Build job, YAML, in place of --capture.")] = None,
    scannet_mesh: Annotated[
        Path | None, typer.Option(help="Folder of a ScanNet scan: mesh with labels, segments, aggregation.")
    ] = None,
    procedural: Annotated[int | None, typer.Option(help="Seed of a generated apartment.", min=0)] = None,
    kind: Annotated[
        str | None, typer.Option(help="Format of the captures, such as 7scenes; auto finds it (docs/datasets.md).")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the scene, for one capture.")] = None,
    frames: Annotated[int | None, typer.Option(help="Frames to fit to; all without it.", min=1)] = None,
    hold_out: Annotated[
        int | None, typer.Option(help="Keep every so many-th frame from fitting and measure on it; 0 for none.", min=0)
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Steps of the optimisation; 0 for fused depth alone.", min=0)
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(help="Minutes of the optimisation, or fewer once --steps are done.", min=0)
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="What the Gaussians begin as: auto, depth (fused) or points (sparse).")
    ] = None,
    register_photos: Annotated[
        str | None,
        typer.Option(help="Move photographs to where the scene says they were taken: auto, on or off."),
    ] = None,
    no_depth_loss: Annotated[bool, typer.Option("--no-depth-loss", help="Optimise by the photographs alone.")] = False,
    device: Annotated[str | None, typer.Option(help="cpu, or cuda by gsplat.")] = None,
    semantics: Annotated[
        str | None,
        typer.Option(help="What names things: ssd_mobilenet, label_files:FOLDER, torch_detector:MODEL, sam_clip, ..."),
    ] = None,
    questions: Annotated[
        Path | None, typer.Option(help="Question file to copy into the scenes it names; captures have none.")
    ] = None,
    cpus: Annotated[int | None, typer.Option(help="Cores to use.", min=1)] = None,
    address: Annotated[str | None, typer.Option(help="Ray cluster, such as auto.")] = None,
    in_process: Annotated[
        bool | None, typer.Option("--in-process/--on-ray", help="One capture is built here, several on Ray.")
    ] = None,
    gaussians: Annotated[int, typer.Option(help="Gaussians of a generated apartment.", min=1000)] = 80_000,
    rooms: Annotated[int, typer.Option(help="Rooms of a generated apartment.", min=1)] = 4,
    views: Annotated[int, typer.Option(help="Views on the camera path of a scan or apartment.", min=1)] = 120,
    seed: Annotated[int, typer.Option(help="Seed of the questions about a scan.", min=0)] = 0,
    plain: Annotated[bool, typer.Option("--plain", help="Plain lines off a terminal, in place of JSON.")] = False,
    log_json: Annotated[bool, typer.Option("--log-json", help="JSON lines also on a terminal.")] = False,
) -> None:
    """Build scene folders; a run over captures that was cut off goes on where it ended.

    Examples: [bold]splatreasoner build --capture kitchen --steps 0 --output built[/bold]

    [bold]splatreasoner build --capture "scans/*" --minutes 10 --output built[/bold]

    [bold]splatreasoner build --procedural 7 --output scenes/apartment-7[/bold]

    [bold]splatreasoner build --scannet-mesh scans/scene0000_00 --output scenes/scene0000_00[/bold]
    """
    sources = {"--capture": capture or None, "--job": job, "--scannet-mesh": scannet_mesh, "--procedural": procedural}
    given = [option for option, value in sources.items() if value is not None]
    if len(given) != 1:
        raise InputError("build", expected=f"one of {', '.join(sources)}", found=" and ".join(given) or "none")
    if output is None and job is None:
        raise InputError("build", field="--output", expected="a folder", found="nothing")
    if capture or job is not None:
        from jobs.builds.build_captures import submit_build
        from jobs.runs.progress import for_terminal, progress_style
        from jobs.verbs.ending import end_build

        if minutes is not None and steps is None and job is None:
            steps = AS_LONG_AS_TIME_LASTS
        changes: dict[tuple[str, ...], Any] = {
            ("build", "frames"): frames,
            ("build", "hold_out"): hold_out,
            ("build", "start"): start,
            ("build", "register_photos"): register_photos,
            ("build", "train", "steps"): steps,
            ("build", "train", "depth_first"): 0.0 if no_depth_loss else None,
            ("build", "train", "minutes"): minutes,
            ("build", "train", "device"): device,
            ("questions",): None if questions is None else str(questions),
            ("output",): None if output is None else str(output),
            ("workers", "cpus"): cpus,
            ("workers", "address"): address,
            ("workers", "in_process"): False if address is not None and in_process is None else in_process,
        }
        if semantics is not None:
            from pipeline.construct.semantics.labels_2d.choose import source_from_text

            changes["build", "semantics", "source"] = source_from_text(semantics).model_dump(mode="json")
        config = _build_job(capture or [], job, kind, name, changes)
        shown = for_terminal("captures", progress_style(plain, log_json))
        end_build(submit_build(config, subject=job or "--capture", progress=shown))
        return
    from jobs.scenes.build import build_procedural, build_scan

    assert output is not None, "only a job names its own"
    if procedural is not None:
        built = build_procedural(procedural, str(output), gaussians=gaussians, rooms=rooms, views=views)
    else:
        assert scannet_mesh is not None
        built = build_scan(scannet_mesh, str(output), views=views, seed=seed)
    print(
        f"{built.uri}: {built.gaussians:,} Gaussians, {built.views} views, {built.objects} objects, "
        f"{built.questions} questions"
    )


def _build_job(
    captures: list[str], job: Path | None, kind: str | None, name: str | None, changes: dict[tuple[str, ...], Any]
) -> BuildJob:
    """Return the job that a file or the captures describe, with what the options change."""
    from jobs.builds.build_job import anchored, checked_build_job, load_build_job

    if job is not None:
        if kind is not None or name is not None:
            raise InputError("build", expected="`kind` and `name` of a capture in the job", found="--kind or --name")
        found = load_build_job(job).model_dump(mode="json")
    else:
        if name is not None and len(captures) > 1:
            raise InputError("--name", expected="one capture", found=len(captures))
        entries = [{"path": one, "kind": kind or "auto", "name": name or ""} for one in captures]
        found = {"name": name or "build", "captures": entries}
    for place, value in changes.items():
        if value is None:
            continue
        inner = found
        for part in place[:-1]:
            inner = inner.setdefault(part, {})
        # A command line has no null.
        inner[place[-1]] = None if place[-1] == "hold_out" and value == 0 else value
    return checked_build_job(anchored(found, Path.cwd()), job or "build")
