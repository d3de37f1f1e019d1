"""What a run takes beside its method: a job with null stages, planned, run to its half, resumed and ended.

    python -m benchmarks.orchestration --questions 2000 --scenes 20                       # on Ray
    python -m benchmarks.orchestration --questions 1000000 --scenes 10000 --in-process --output FOLDER
    NULL_MODEL_S=1 NULL_CPU_S=0.05 python -m benchmarks.orchestration --questions 200 --scenes 2 --batch 1

It prints milliseconds and driver memory along the way, how long planning and resuming took, and the files of the run.
The second form is the simulation of a large run: the stages are calls in the driver's own process. In the third the
stages are not null: a question waits a second for models, exponentially spread, and computes 50 ms.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.null_steps import STEPS
from jobs.config import JobConfig
from jobs.runs.progress import Silent
from jobs.runs.submit import RunResult, resume, submit
from schemas.plan import PLAN_FILE

SAMPLES = 10
"""Lines printed along each half of the run."""
CAMERAS = {
    **{"w": 4, "h": 3, "fl_x": 4.0, "fl_y": 4.0, "cx": 2.0, "cy": 1.5},
    "frames": [{"file_path": "1.png", "transform_matrix": [[float(i == j) for j in range(4)] for i in range(4)]}],
}


class Watch(Silent):
    """Prints time and memory along a run, and stops it at a number of questions as Ctrl-C would.

    Args:
        stop_at: Questions after which to stop; None for never.
    """

    def __init__(self, stop_at: int | None = None) -> None:
        self._stop_at = stop_at

    def begin(self, total: int, done: int) -> None:
        """Start counting."""
        self.begun = time.perf_counter()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
        print(f"{done:,} of {total:,} done; driver holds {memory_mb():,.0f} MB, {peak:,.0f} MB at most", flush=True)
        self._done, self._every = done, max(1, total // (2 * SAMPLES))
        self._last = done, self.begun, time.process_time(), cpu_s()

    def advance(self, error: str) -> None:
        """Count a question."""
        self._done += 1
        if self._done % self._every == 0:
            now = self._done, time.perf_counter(), time.process_time(), cpu_s()
            count, *spent = (after - before for after, before in zip(now, self._last, strict=True))
            wall, driver, both = (1e3 * seconds / count for seconds in spent)
            self._last = now
            print(
                f"{self._done:>9,} questions: {wall:6.2f} ms each; CPU {driver:.2f} ms in the driver, {both:.2f} ms in "
                f"all; driver holds {memory_mb():,.0f} MB",
                flush=True,
            )
        if self._done == self._stop_at:
            os.kill(os.getpid(), signal.SIGTERM)


def cpu_s() -> float:
    """Return the CPU seconds of this process and of those below it: Ray's own and its workers."""
    parents, used = dict[int, int](), dict[int, float]()
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rpartition(")")[2].split()
            parents[int(path.parent.name)] = int(fields[1])
            used[int(path.parent.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    ours = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(used.get(pid, 0.0) for pid in ours)


def memory_mb() -> float:
    """Return the resident memory of this process, megabytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def make_scenes(folder: Path, scenes: int, questions: int) -> None:
    """Write scene folders of a few bytes with their questions."""
    for scene in range(scenes):
        name = f"scene{scene:05d}"
        place = folder / name
        place.mkdir(parents=True)
        (place / "gaussians.ply").write_bytes(name.encode())
        (place / "transforms.json").write_text(json.dumps(CAMERAS))
        own = range(scene * questions // scenes, (scene + 1) * questions // scenes)
        text = "What stands beside the lamp in room {} and what colour is it?"
        lines = (
            {"question_id": f"q{n:07d}", "scene": name, "task": "eqa", "question": text.format(n), "answer": "a sofa"}
            for n in own
        )
        (place / "questions.jsonl").write_text("".join(json.dumps(record) + "\n" for record in lines))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--questions", type=int, default=2000)
    options.add_argument("--scenes", type=int, default=20)
    options.add_argument("--in-process", action="store_true", help="without Ray")
    options.add_argument("--cpus", type=int, default=2, help="CPU slots of Ray")
    options.add_argument("--chunk", type=int, default=25, help="questions a unit")
    options.add_argument("--batch", type=int, help="questions that travel together; adapted when left out")
    options.add_argument("--in-flight", type=int, help="questions in flight; adapted when left out")
    options.add_argument("--memory-mb", type=int, help="megabytes that questions in flight may hold")
    options.add_argument("--output", type=Path, help="an empty folder to keep; a temporary one when left out")
    given = options.parse_args()
    folder = given.output or Path(tempfile.mkdtemp(prefix="orchestration-"))
    try:
        start = time.perf_counter()
        make_scenes(folder / "scenes", given.scenes, given.questions)
        print(f"{given.scenes:,} scenes made in {time.perf_counter() - start:.1f} s", flush=True)
        workers = {"in_process": given.in_process, "cpus": given.cpus, "chunk": given.chunk, "batch": given.batch}
        workers |= {"questions_in_flight": given.in_flight, "memory_mb": given.memory_mb}
        job = JobConfig.model_validate(
            {
                "name": "orchestration",
                "output": str(folder / "run"),
                "scenes": str(folder / "scenes" / "*"),
                "workers": workers,
                "images": False,
            }
        )
        half, rest = Watch(given.questions // 2), Watch()
        start = time.perf_counter()
        print(f"submit: {half_of(lambda: submit(job, steps=STEPS, progress=half), half, start)}", flush=True)
        start = time.perf_counter()
        print(f"resume: {half_of(lambda: resume(job.output, steps=STEPS, progress=rest), rest, start)}", flush=True)
        print(f"plan: {Path(job.output, PLAN_FILE).stat().st_size / 1e6:.1f} MB")
        files = Counter(path.relative_to(job.output).parts[0] for path in Path(job.output).rglob("*") if path.is_file())
        size = sum(path.stat().st_size for path in Path(job.output).rglob("*") if path.is_file())
        print(f"run folder: {size / 1e6:,.1f} MB in {files.total():,} files: {dict(files)}")
    finally:
        if given.output is None:
            shutil.rmtree(folder)


def half_of(work: Callable[[], RunResult], watch: Watch, start: float) -> str:
    """Do a half of the run and say how it went."""
    driven = work().driven
    ended = time.perf_counter()
    return (
        f"{driven.done:,} of {driven.planned:,} questions committed; {watch.begun - start:.1f} s before the first "
        f"question, {ended - watch.begun:.1f} s after that"
    )


if __name__ == "__main__":
    main()
