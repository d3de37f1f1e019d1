"""What the lossy policies of search change in the answers: questions answered otherwise, and their scores.

    python -m benchmarks.policy_answers --seeds 301 302 --output FOLDER [--jobs 2]

Apartments are generated into the folder where they are not there yet, and all their questions are answered by the
symbolic model under each policy. Scores are those of the verified arm; differences are paired with the exact
method, intervals 95 % bootstrap over scenes and then questions. Seconds are CPU time of one thread for the visibility
index and the clusters of a scene.
"""

from __future__ import annotations

import argparse
import asyncio
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from jobs.scenes.build import build_procedural
from pipeline.config import MethodConfig
from pipeline.metrics.llm_match import match_score
from pipeline.metrics.significance import bootstrap_interval
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from pipeline.query.visibility import PRESETS
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from pipeline.tasks.method import conclude, decide, find_evidence, propose
from schemas import storage
from schemas.question_file import load_questions

EXACT = "exact"
POLICIES: Mapping[str, dict[str, Any]] = {
    EXACT: {},
    "preset fast": {"visibility": PRESETS["fast"].model_dump()},
    "160 px": {"visibility": {"long_side": 160}},
    "80 px": {"visibility": {"long_side": 80}},
    "opacity >= 0.2": {"visibility": {"min_opacity": 0.2}},
    "every 2nd view": {"visibility": {"every_nth": 2}},
    "every 4th view": {"visibility": {"every_nth": 4}},
    "60 farthest views": {"visibility": {"most_views": 60}},
    "cubes of 2 cm": {"clustering": {"voxel_m": 0.02}},
    "cubes of 5 cm": {"clustering": {"voxel_m": 0.05}},
    "volume score": {"initial_views": {"score": "volume"}},
}
ARM = "verified"
TASKS = {"eqa": "LLM-Match", "ground_one": "3D mIoU", "ground_many": "instance mIoU"}


def run(seed: int, folder: str, limit: int | None) -> list[dict[str, Any]]:
    """Return one record a question and policy of an apartment."""
    uri = f"{folder}/apartment-{seed}"
    if not Path(uri).is_dir():
        build_procedural(seed, uri)
    scene, questions = load_scene(uri), load_questions(storage.join(uri, "questions.jsonl"))[:limit]
    caller = Caller(dict.fromkeys(STAGES, SymbolicModel()), Prompts.load(), None)
    warm, exact = SceneContext(scene), MethodConfig()
    warm.found_clusters(warm.vocabulary[0], exact)  # kernels are compiled, or read, before anything is timed
    records = []
    for policy, settings in POLICIES.items():
        config, context = MethodConfig.model_validate(settings), SceneContext(scene)
        context.gaussians  # noqa: B018 prepared before anything is timed
        for question in questions:
            evidence = asyncio.run(find_evidence(question, context.vocabulary, caller, config))
            start = time.thread_time()
            for category in evidence.categories:
                context.found_clusters(category, config)
            seconds = time.thread_time() - start
            proposal = propose(context, question, evidence, config)
            decision = asyncio.run(decide(question, proposal, caller, config))
            arm = next(
                arm for arm in conclude(context, question, evidence, proposal, decision, config).arms if arm.arm == ARM
            )
            iou = None if arm.iou is None else 100 * arm.iou
            score = iou if question.task != "eqa" else None if arm.mark is None else match_score(arm.mark)
            records.append(
                {
                    "policy": policy,
                    "scene": question.scene,
                    "question": f"{question.scene} {question.question_id}",
                    "task": question.task,
                    "score": score,
                    "answer": (arm.status, arm.answer),
                    "views": [group.initial_view for group in proposal.seen],
                    "seconds": seconds,
                }
            )
    return records


def table(records: list[dict[str, Any]]) -> None:
    """Print, for every policy, what it costs and what it changes."""
    own = {policy: [r for r in records if r["policy"] == policy] for policy in POLICIES}
    exact = {record["question"]: record for record in own[EXACT]}
    scenes = len({record["scene"] for record in records})
    print(f"{scenes} apartments, {len(exact)} questions, {ARM} arm\n")
    print(f"{'policy':20s} {'s a scene':>10s} {'views differ':>13s} {'answers differ':>15s}", end="")
    print("".join(f"{name:>28s}" for name in TASKS.values()))
    for policy, rows in own.items():
        views = np.mean([record["views"] != exact[record["question"]]["views"] for record in rows])
        differ = np.mean([record["answer"] != exact[record["question"]]["answer"] for record in rows])
        seconds = sum(record["seconds"] for record in rows) / scenes
        print(f"{policy:20s} {seconds:10.2f} {views:13.1%} {differ:15.1%}", end="")
        for task in TASKS:
            both = [r for r in rows if r["task"] == task and None not in (r["score"], exact[r["question"]]["score"])]
            if not both:
                print(f"{'-':>28s}", end="")
                continue
            gaps = np.array([record["score"] - exact[record["question"]]["score"] for record in both])
            gap = bootstrap_interval(gaps, [record["scene"] for record in both], np.random.default_rng(0))
            span = "" if gap.low is None or policy == EXACT else f" {gap.mean:+.1f} [{gap.low:+.1f}, {gap.high:+.1f}]"
            print(f"{np.mean([record['score'] for record in both]):8.1f}{span:>20s}", end="")
        print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", required=True, help="apartments to generate and answer")
    parser.add_argument("--output", type=Path, required=True, help="folder of the apartments")
    parser.add_argument("--jobs", type=int, default=1, help="apartments at once")
    parser.add_argument("--limit", type=int, help="questions of each apartment")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    work = partial(run, folder=str(options.output), limit=options.limit)
    # Spawned, since a forked child would inherit locks of threads that libraries may have started.
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        table([record for records in pool.map(work, options.seeds) for record in records])


if __name__ == "__main__":
    main()
