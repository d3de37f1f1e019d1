"""The demo: apartments are generated, their questions answered on local Ray by the offline symbolic model.

What an earlier demo left is used again where it is still what this code would make: scenes by a hash of their
parameters and of the code that generates them, the run by its plan.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import shutil
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from jobs.config import JobConfig, WorkersConfig
from jobs.runs.plan import content_id, plan_units
from jobs.runs.progress import Progress, for_terminal
from jobs.runs.submit import RunResult, submit
from jobs.scenes.build import build_procedural
from schemas.run_folder import RUN_FILE, RunFolder
from workers.ray_session import WORKER_ENVIRONMENT

SEEDS = range(101, 1_101)
"""Seeds of the apartments, in order. Those below were looked at while the symbolic model's rules were written, so
figures on them would flatter it."""
CHUNK = 10
"""Questions a unit: small, so that an interrupted demo has lost little."""
GENERATORS = ("pipeline/scene/procedural", "pipeline/scene/questions", "pipeline/scene/color_names.py")
"""Code that shapes a generated scene and its questions."""


def run_demo(
    output: Path,
    *,
    scenes: int = 3,
    fresh: bool = False,
    in_process: bool = False,
    progress: Progress | None = None,
) -> RunResult:
    """Generate what is missing, answer what is not answered yet, and return the run.

    Args:
        output: Folder for `scenes/` and `run/`.
        scenes: Apartments.
        fresh: Remove what an earlier demo left there.
        in_process: Without Ray.
        progress: Who is told how it goes; None for the terminal.
    """
    shown = progress or for_terminal()
    if fresh:
        for path in (output / "run", *sorted((output / "scenes").glob("apartment-*"))):
            _remove(path)
    folders = _build_scenes(output / "scenes", scenes, shown)
    config = JobConfig(
        name="demo",
        output=str(output / "run"),
        scenes=tuple(folders),
        workers=WorkersConfig(in_process=in_process, chunk=CHUNK),
    )
    run = RunFolder(config.output)
    if run.exists() and [u.id for u in run.units()] != [u.id for u in plan_units(config)]:
        shown.say(f"{run.root} holds a demo of other scenes, settings or code: starting over")
        _remove(Path(run.root))
    return submit(config, subject="demo", progress=shown)


def _build_scenes(folder: Path, count: int, progress: Progress) -> list[str]:
    """Build the apartments that are missing, several at once; return all their folders."""
    wanted = {seed: folder / f"apartment-{seed}" for seed in SEEDS[:count]}
    stamp = content_id({"code": _code_sha256()})
    missing = {seed: path for seed, path in wanted.items() if not _built(path, stamp)}
    if missing:
        progress.say(f"generating {len(missing)} apartments")
        for path in missing.values():
            _remove(path)
        os.environ.update({name: value for name, value in WORKER_ENVIRONMENT.items() if name.endswith("_THREADS")})
        workers = min(len(missing), len(os.sched_getaffinity(0)))
        # Spawned, since a forked child would inherit locks of threads that libraries may have started.
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            jobs = {pool.submit(build_procedural, seed, str(path)): path for seed, path in missing.items()}
            for job in as_completed(jobs):
                built, path = job.result(), jobs[job]
                _stamp_file(path).write_text(stamp)
                progress.say(
                    f"  {path.name}: {built.gaussians:,} Gaussians, {built.views} views, {built.questions} questions"
                )
    return [str(path) for path in wanted.values()]


def _built(path: Path, stamp: str) -> bool:
    return _stamp_file(path).is_file() and _stamp_file(path).read_text() == stamp and path.is_dir()


def _stamp_file(path: Path) -> Path:
    """Beside the scene's folder, not in it: it is no part of the scene."""
    return path.with_name(f"{path.name}.built")


def _code_sha256() -> str:
    root = Path(__file__).resolve().parent.parent
    files: Sequence[Path] = sorted(
        file for name in GENERATORS for file in ([root / name] if name.endswith(".py") else (root / name).rglob("*.py"))
    )
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


def _remove(path: Path) -> None:
    """Remove a folder that a demo made, and only such a one."""
    if path.is_dir() and ((path / RUN_FILE).exists() or _stamp_file(path).exists()):
        _stamp_file(path).unlink(missing_ok=True)  # first: what is left of a folder without it is built again
        shutil.rmtree(path)
