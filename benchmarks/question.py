"""Milliseconds a question by stage in a warm scene, without the models: the target is a median under 500 ms.

    python -m benchmarks.question [SCENE] [--questions 30] [--threads 2]

Warm: the scene is loaded and prepared, its visibility index was read from disk and joined, and a few questions were
asked before. Without a scene: a generated apartment of 500,000 Gaussians and 300 views of 640 x 480. The models are
the symbolic ones; what they take is not counted. Questions are asked one after the other in one process, like in a
run: what an earlier question found out about a category is kept. "new" are the questions that search a category which
none asked for before. Exits with 1 when the median misses the target.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.apartments import apartment
from pipeline.config import MethodConfig
from pipeline.models.caller import Caller
from pipeline.models.clients import make_caller
from pipeline.models.config import ModelConfig
from pipeline.scene.load import load_scene
from pipeline.tasks.method import SceneContext, conclude, decide, find_evidence, propose
from schemas.question_file import load_questions
from schemas.questions import Question
from workers.index_steps import IndexPart, adopt_index, index_views, join_index, read_index

TARGET_MS = 500.0
WARM_UP = 3
"""Questions asked before: kernels are compiled or read from numba's cache by then."""
SHOWN = {"index": "visibility"}
"""Stages of table `timings` that are shown under another name."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What one question cost."""

    stages: dict[str, float]
    """Milliseconds by stage."""
    total: float
    """Milliseconds of proposing and concluding."""
    cpu: float
    """Milliseconds of CPU in the same time."""
    new: bool
    """It searched a category for the first time."""
    views: int
    """Views shown to the models."""


def open_warm(uri: str, config: MethodConfig, folder: str, threads: int) -> SceneContext:
    """Return a scene's context with the whole index in it, as a worker of a later run gets it."""
    scene = load_scene(uri)
    print(f"{scene.name}: {len(scene.gaussians):,} Gaussians, {len(scene.views)} views")
    first = SceneContext(scene)
    start = time.perf_counter()
    index_views(first, config, read_index(scene, config, folder).unstored, 0, 1)
    print(f"  index rendered and stored   {time.perf_counter() - start:8.2f} s, once ever")
    start = time.perf_counter()
    found = read_index(scene, config, folder)
    assert not found.unstored.views
    joined = join_index(scene, config, [IndexPart.of(found.rows)])
    print(f"  index read and joined       {(time.perf_counter() - start) * 1e3:8.1f} ms, once a run")
    context = SceneContext(scene, threads=threads)
    start = time.perf_counter()
    adopt_index(context, config, joined)
    print(f"  Gaussians prepared          {(time.perf_counter() - start) * 1e3:8.1f} ms, once a process")
    return context


def ask(context: SceneContext, question: Question, caller: Caller, config: MethodConfig, known: set[str]) -> Asked:
    """Return what a question costs; its categories are known from then on."""

    async def whole() -> Asked:
        evidence = await find_evidence(question, context.vocabulary, caller, config)
        wall, cpu = time.perf_counter(), time.process_time()
        proposal = propose(context, question, evidence, config)
        proposed, used = time.perf_counter() - wall, time.process_time() - cpu
        decision = await decide(question, proposal, caller, config)
        wall, cpu = time.perf_counter(), time.process_time()
        conclude(context, question, evidence, proposal, decision, config)
        concluded, used = time.perf_counter() - wall, used + time.process_time() - cpu
        stages: Counter[str] = Counter()
        for stage in proposal.times:
            stages[SHOWN.get(stage.stage, stage.stage)] += stage.seconds * 1e3
        stages["conclude"] = concluded * 1e3
        new = not set(evidence.categories) <= known
        known.update(evidence.categories)
        return Asked(dict(stages), (proposed + concluded) * 1e3, used * 1e3, new, len(proposal.pictures))

    return asyncio.run(whole())


def report(asked: Sequence[Asked]) -> float:
    """Print medians and 95th percentiles by stage; return the median in all."""
    stages = list(dict.fromkeys(stage for one in asked for stage in one.stages))
    table = {stage: np.array([one.stages.get(stage, 0.0) for one in asked]) for stage in stages}
    total = np.array([one.total for one in asked])
    new = np.array([one.new for one in asked])
    table["all"] = total
    print(f"\n  {'ms a question':14} {'median':>8} {'p95':>8} {'mean':>8} {'share':>7} {'median, new':>12}")
    for stage, spent in table.items():
        fresh = f"{np.median(spent[new]):12.1f}" if new.any() else ""
        share = f"{spent.sum() / total.sum():7.1%}"
        print(
            f"  {stage:14} {np.median(spent):8.1f} {np.percentile(spent, 95):8.1f} {spent.mean():8.1f} {share} {fresh}"
        )
    cpu = np.array([one.cpu for one in asked])
    print(f"  {'CPU, all':14} {np.median(cpu):8.1f} {np.percentile(cpu, 95):8.1f} {cpu.mean():8.1f}")
    heaviest = max(stages, key=lambda stage: table[stage].sum())
    views = np.mean([one.views for one in asked])
    print(
        f"\n  {len(asked)} questions, {new.sum()} of them new, {views:.1f} pictures each; most time goes to {heaviest}"
    )
    return float(np.median(total))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="scene folder with questions.jsonl")
    parser.add_argument("--questions", type=int, default=30)
    parser.add_argument("--threads", type=int, default=2, help="pictures of a question rendered side by side")
    args = parser.parse_args()
    folder = Path(args.scene or apartment(gaussians=500_000, views=300))
    config = MethodConfig()
    questions = load_questions(folder / "questions.jsonl")
    # Evenly through the file, which goes task by task.
    chosen = [questions[i] for i in np.linspace(0, len(questions) - 1, args.questions).astype(int)]
    with tempfile.TemporaryDirectory() as scratch:
        context = open_warm(str(folder), config, str(Path(scratch, "index")), args.threads)
        caller, known = make_caller(ModelConfig(), Path(scratch, "calls")), set[str]()
        for question in questions[:WARM_UP]:
            ask(context, question, caller, config, known)
        median = report([ask(context, question, caller, config, known) for question in chosen])
    print(f"  median {median:.0f} ms, target {TARGET_MS:.0f} ms")
    sys.exit(median >= TARGET_MS)


if __name__ == "__main__":
    main()
