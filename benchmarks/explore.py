"""Does searching free space for views beat the recorded view and the paper's four moves? Visibility, answers, cost.

    for seed in 201 202 203 204; do splatreasoner build --procedural $seed --output scenes/apartment-$seed; done
    python benchmarks/explore.py scenes/apartment-20* --jobs 2 --output rows.jsonl
    python benchmarks/explore.py rows.jsonl        # the tables once more

Every question of every scene is answered by the symbolic model with each method. Scores are those of the final views;
intervals are 95 % bootstrap over scenes and then questions, p is a paired permutation test over questions against
`perturb V=4`. Milliseconds are CPU time of one thread, so that they do not depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.baselines.registry import answer_question
from pipeline.config import MethodConfig
from pipeline.metrics.significance import bootstrap_interval, permutation_p
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from schemas import storage
from schemas.question_file import load_questions

METHODS: dict[str, dict[str, Any]] = {
    "initial only": {"count": 0},
    "perturb V=4": {"count": 4},
    **{f"explore V={count}": {"policy": "explore", "count": count} for count in (1, 2, 3, 4)},
}
BASE = "perturb V=4"
TASKS = {"eqa": "LLM-Match", "ground_one": "3D mIoU", "ground_many": "instance mIoU"}


def run(uri: str, method: str, settings: dict[str, Any], limit: int | None) -> list[dict[str, Any]]:
    """Return one record a question: score, best visibility and cost of each of its clusters."""
    time.perf_counter = time.thread_time  # in this process: all that is timed below runs in one thread
    config = MethodConfig.model_validate({"novel_views": settings})
    context = SceneContext(load_scene(uri))
    caller = Caller(dict.fromkeys(STAGES, SymbolicModel()), Prompts.load(), None)
    index = context.index(config.visibility)
    index.build()
    explores = config.novel_views.policy == "explore"
    start = time.perf_counter()
    if explores:
        context.explorer(config).space  # noqa: B018  once a scene, like the index
    once = time.perf_counter() - start
    book, records = context.pictures(config.images), []
    for question in load_questions(storage.join(uri, "questions.jsonl"))[:limit]:
        searched = context.explorer(config).renders if explores else 0
        pictures = book.renders
        rows = asyncio.run(answer_question(context, question, caller, config))
        final = next(arm for arm in rows.arms if arm.arm == "final")
        score = final.iou if final.mark is None else (final.mark - 1) * 25.0
        if question.task != "eqa" and final.iou is not None:
            score = final.iou * 100
        best: dict[int, float] = {}
        for row in rows.candidates:
            best[row.cluster] = max(best.get(row.cluster, 0.0), row.visibility)
        seconds = sum(t.seconds for t in rows.timings if t.stage in ("explore", "perturb"))
        places = {row.cluster: f"{context.scene.name} {row.category} {row.centre}" for row in rows.clusters}
        records.append(
            {
                "method": method,
                "scene": context.scene.name,
                "question": question.question_id,
                "task": question.task,
                "category": question.category,
                "score": score,
                "clusters": {places[number]: visibility for number, visibility in best.items()},
                "seconds": seconds,
                "once_s": once,
                "searched": (context.explorer(config).renders if explores else 0) - searched,
                "pictures": book.renders - pictures,
            }
        )
    return records


def table(records: list[dict[str, Any]]) -> None:
    """Print visibility, scores and cost of every method."""
    methods = [method for method in METHODS if any(record["method"] == method for record in records)]
    done = {(record["scene"], record["method"]) for record in records}
    records = [r for r in records if all((r["scene"], method) in done for method in methods)]
    seen = {m: _best_by_cluster(r for r in records if r["method"] == m) for m in methods}
    print(f"{len({r['scene'] for r in records})} scenes, {len(seen[methods[0]])} clusters")
    print(f"\n{'method':14s} {'best S_vis':>11s} {'ms/cluster':>11s} {'searched':>9s} {'pictures':>9s}")
    for method in methods:
        own = [record for record in records if record["method"] == method]
        clusters = len(seen[method])
        cost = [sum(record[name] for record in own) / clusters for name in ("seconds", "searched", "pictures")]
        values = np.array(list(seen[method].values()))
        print(f"{method:14s} {np.median(values):11.3f} {cost[0] * 1e3:11.1f} {cost[1]:9.1f} {cost[2]:9.1f}", end="")
        _against({k: [v, "all"] for k, v in seen[BASE].items()}, {k: [v, "all"] for k, v in seen[method].items()})
    for task, name in {**TASKS, "all": "all questions, 0 to 100"}.items():
        print(f"\n{name}")
        for method in methods:
            scores = {}
            for m in (method, BASE):
                own = [r for r in records if r["method"] == m and task in (r["task"], "all") and r["score"] is not None]
                scores[m] = {r["scene"] + r["question"]: [r["score"], r["scene"]] for r in own}
            values = np.array([score for score, _ in scores[method].values()])
            mean = bootstrap_interval(values, [s for _, s in scores[method].values()], np.random.default_rng(0))
            if mean.mean is None or mean.low is None or mean.high is None:
                continue
            print(f"  {method:14s} {mean.mean:5.1f} [{mean.low:.1f}, {mean.high:.1f}] n={mean.n}", end="")
            _against(scores[BASE], scores[method])


def _best_by_cluster(records: Iterable[dict[str, Any]]) -> dict[str, float]:
    best: dict[str, float] = {}
    for record in records:
        best.update(record["clusters"])
    return best


def _against(base: dict[str, list[Any]], other: dict[str, list[Any]]) -> None:
    """Print the paired difference on what both have."""
    both = [key for key in base if key in other]
    first, second = (np.array([values[key][0] for key in both]) for values in (base, other))
    gap = bootstrap_interval(second - first, [base[key][1] for key in both], np.random.default_rng(0))
    p = permutation_p(first, second, np.random.default_rng(0))
    if gap.mean is None or gap.low is None or gap.high is None or p is None:
        print()
    else:
        print(f"   {gap.mean:+.3f} [{gap.low:+.3f}, {gap.high:+.3f}] p {p:.4f} against {BASE}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", help="scene folders with questions, or files of --output")
    parser.add_argument("--methods", nargs="*", default=list(METHODS), help="some of: " + ", ".join(METHODS))
    parser.add_argument("--search", default="{}", help="JSON: fields of novel_views.explore to change")
    parser.add_argument("--questions", type=int, help="only the first so many of each scene")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", type=Path, help="JSON lines file for the records")
    args = parser.parse_args()
    if args.scenes[0].endswith(".jsonl"):
        records = [json.loads(line) for path in args.scenes for line in Path(path).read_text().splitlines()]
    else:
        records = []
        with ProcessPoolExecutor(args.jobs, multiprocessing.get_context("spawn")) as pool:
            parts = []
            for scene in args.scenes:
                for method in args.methods:
                    settings = {**METHODS[method], "explore": json.loads(args.search)}
                    parts.append(pool.submit(run, scene, method, settings, args.questions))
            for part in as_completed(parts):
                records += part.result()
                if args.output:
                    args.output.write_text("".join(json.dumps(record) + "\n" for record in records))
    table(records)


if __name__ == "__main__":
    main()
