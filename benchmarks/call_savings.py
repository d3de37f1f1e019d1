"""What sparing model calls saves and costs: calls, tokens and scores without savings, with exact and lossy ones.

    python -m benchmarks.call_savings --seeds 301 302 303 304 --output FOLDER
    python -m benchmarks.call_savings --output FOLDER        # the tables once more

Apartments are generated into the folder, four rooms each, and all their questions are answered by the symbolic model.
Evidence and candidate views of a question are the same for every row of the tables; only what is asked about them
differs. Tokens are reckoned, since the symbolic model reads none: a token is three bytes of text, a picture 800 tokens.
Nothing is cached, so every row pays for all it asks. Scores are those of the verified arm, the difference is paired
with `exact savings`; intervals are 95 % bootstrap over scenes and then questions.
"""

from __future__ import annotations

import argparse
import asyncio
import json
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from jobs.scenes.build import build_procedural
from pipeline.config import MethodConfig
from pipeline.metrics.llm_match import match_score
from pipeline.metrics.significance import Interval, bootstrap_interval
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES
from pipeline.models.estimate import BYTES_PER_TOKEN, Price, TokenEstimate
from pipeline.models.messages import Reply, Request
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from pipeline.tasks.method import conclude, decide, find_evidence, propose
from schemas import storage
from schemas.question_file import load_questions

Record = dict[str, Any]
BASE = "exact savings"
WAYS: Mapping[str, dict[str, Any]] = {
    "no savings": {"exact_savings": False},
    BASE: {},
    "stop_when_definite": {"stop_when_definite": True},
    **{
        f"skip_redundant, {share:.0%}": {"skip_redundant_views": True, "redundant_share": share}
        for share in (0.0, 0.02, 0.05, 0.1, 0.2)
    },
    "both policies": {"stop_when_definite": True, "skip_redundant_views": True, "redundant_share": 0.05},
    "choice by image": {"design": "image"},
    "choice by image + text": {"design": "image_text"},
}
TASKS = {"eqa": "LLM-Match", "ground_one": "3D mIoU", "ground_many": "instance mIoU"}
IMAGE_TOKENS = 800
ARM = "verified"


class Metered(SymbolicModel):
    """The symbolic model with reckoned tokens."""

    _estimate = TokenEstimate(IMAGE_TOKENS, 0, Price())

    async def complete(self, request: Request) -> Reply:
        """Return the reply and what it would have taken."""
        reply = await super().complete(request)
        prompt_tokens = self._estimate.most(request)[0]
        return Reply(reply.text, prompt_tokens, int(len(reply.text.encode()) / BYTES_PER_TOKEN) + 1, reply.model)


def run(seed: int, folder: str, limit: int | None) -> list[Record]:
    """Return one record a question and way of an apartment, which is generated if it is not there."""
    uri = f"{folder}/apartment-{seed}"
    if not Path(uri).is_dir():
        build_procedural(seed, uri)
    context = SceneContext(load_scene(uri))
    caller = Caller(dict.fromkeys(STAGES, Metered()), Prompts.load(), None)
    configs = {way: MethodConfig.model_validate({"judging": judging}) for way, judging in WAYS.items()}
    records = []
    for question in load_questions(storage.join(uri, "questions.jsonl"))[:limit]:
        evidence = asyncio.run(find_evidence(question, context.vocabulary, caller, configs[BASE]))
        proposal = propose(context, question, evidence, configs[BASE])
        for way, config in configs.items():
            decision = asyncio.run(decide(question, proposal, caller, config))
            rows = conclude(context, question, evidence, proposal, decision, config)
            arm = next(arm for arm in rows.arms if arm.arm == ARM)
            iou = None if arm.iou is None else 100 * arm.iou
            # Marks are no part of the method: they are asked for where it is measured.
            calls = [call for call in rows.calls if call.stage != "judge"]
            records.append(
                {
                    "way": way,
                    "scene": question.scene,
                    "question": f"{question.scene} {question.question_id}",
                    "task": question.task,
                    "score": iou if question.task != "eqa" else None if arm.mark is None else match_score(arm.mark),
                    "answer": [arm.status, arm.answer, arm.chosen, arm.views],
                    "calls": dict(Counter(call.stage for call in calls)),
                    "tokens": sum(call.prompt_tokens + call.completion_tokens for call in calls),
                    "saved": {f"{s.stage}: {s.reason}": s.calls for s in decision.saved if s.stage != "judge"},
                }
            )
    return records


def tables(records: list[Record]) -> None:
    """Print calls, tokens and scores of every way."""
    own = {way: [record for record in records if record["way"] == way] for way in WAYS}
    asked = len(own[BASE])
    print(f"{len({r['scene'] for r in records})} apartments, {asked} questions, calls and tokens a question\n")
    stages = ("evidence", "view_answer", "choice", "answer", "verify")
    print(f"{'':24s} {'calls':>6s} {'tokens':>7s} {'':6s}", *(f"{stage:>11s}" for stage in stages))
    most = sum(record["tokens"] for record in own["no savings"])
    for way, rows in own.items():
        calls = sum((Counter(record["calls"]) for record in rows), Counter())
        tokens = sum(record["tokens"] for record in rows)
        share = [f"{calls[stage] / asked:11.2f}" for stage in stages]
        print(f"{way:24s} {calls.total() / asked:6.2f} {tokens / asked:7.0f} {tokens / most:5.0%} ", *share)
    for way in (BASE, "both policies"):
        saved = sum((Counter(record["saved"]) for record in own[way]), Counter())
        print(f"\ncalls saved a question, {way}: {saved.total() / asked:.2f}")
        for reason, count in sorted(saved.items()):
            print(f"  {reason:40s} {count / asked:6.2f}")
    base = {record["question"]: record for record in own[BASE]}
    equal = sum(record["answer"] == base[record["question"]]["answer"] for record in own["no savings"])
    scored = sum(record["score"] == base[record["question"]]["score"] for record in own["no savings"])
    print(f"\nno savings against {BASE}: {equal} of {asked} answers and {scored} scores are the same")
    for task, name in TASKS.items():
        print(f"\n{name}, {ARM} arm")
        for way, rows in own.items():
            both = scored_by_both(rows, base, task)
            if not both:
                continue
            changed = sum(record["answer"] != base[record["question"]]["answer"] for record in both)
            mean, gap = np.mean([record["score"] for record in both]), gap_to(base, both)
            span = "" if gap.low is None else f"{gap.mean:+5.1f} [{gap.low:+.1f}, {gap.high:+.1f}]"
            print(f"  {way:24s} {mean:5.1f} n={len(both):4d} {changed:4d} answers differ {span}")


def scored_by_both(rows: list[Record], base: Mapping[str, Record], task: str) -> list[Record]:
    """Return the questions of a task that were scored here and in the base."""
    return [r for r in rows if r["task"] == task and None not in (r["score"], base[r["question"]]["score"])]


def gap_to(base: Mapping[str, Record], rows: list[Record]) -> Interval:
    """Return the mean difference to the base, question by question."""
    gaps = np.array([record["score"] - base[record["question"]]["score"] for record in rows])
    return bootstrap_interval(gaps, [record["scene"] for record in rows], np.random.default_rng(0))


def plot(records: list[Record], path: Path) -> None:
    """Draw what each way loses or gains over the tokens it takes, one panel a task."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    base = {record["question"]: record for record in records if record["way"] == BASE}
    curve = [BASE, *(way for way in WAYS if way.startswith("skip_redundant"))]
    markers = dict(zip((way for way in WAYS if way not in curve), "os^DvP", strict=False))
    figure, panels = plt.subplots(1, len(TASKS), figsize=(12, 4), layout="constrained", sharey=True)
    for panel, (task, name) in zip(panels, TASKS.items(), strict=True):
        places = {}
        for way in WAYS:
            own = [record for record in records if record["way"] == way]
            gap = gap_to(base, scored_by_both(own, base, task))
            tokens = np.mean([record["tokens"] for record in own if record["task"] == task]) / 1e3
            places[way] = tokens, gap.mean
            if gap.low is not None:
                panel.vlines(tokens, gap.low, gap.high, color="0.8", zorder=0)
        panel.axhline(0, color="0.6", linewidth=0.8)
        panel.plot(*zip(*(places[way] for way in curve), strict=True), "k.-", label="skip_redundant_views")
        for way, marker in markers.items():
            panel.plot(*places[way], marker, markersize=8, alpha=0.7, label=way)
        for number, way in enumerate(curve):
            label = "exact" if way == BASE else way.rpartition(" ")[2]
            offset = (0, 7 if number % 2 else -14)
            panel.annotate(label, places[way], xytext=offset, textcoords="offset points", ha="center", fontsize=8)
        panel.set(title=f"{name} ({task})", xlabel="tokens a question, thousands", xlim=(0, None))
    panels[0].set_ylabel(f"score against {BASE}, with 95 % intervals")
    panels[0].legend(fontsize=8, loc="upper right")
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=[], help="apartments to generate and answer")
    parser.add_argument("--output", type=Path, required=True, help="folder of the apartments and of records.jsonl")
    parser.add_argument("--plot", type=Path, help="picture of scores over tokens")
    parser.add_argument("--jobs", type=int, default=1, help="apartments at once")
    parser.add_argument("--limit", type=int, help="questions of each apartment")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "records.jsonl"
    # Spawned, since a forked child would inherit locks of threads that libraries may have started.
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        under_way = [pool.submit(run, seed, str(options.output), options.limit) for seed in options.seeds]
        for done in as_completed(under_way):
            records = done.result()
            print(f"{records[0]['scene']}: {len(records) // len(WAYS)} questions", flush=True)
            with path.open("a") as file:
                file.writelines(json.dumps(record) + "\n" for record in records)
    found = [json.loads(line) for line in path.read_text().splitlines()]
    tables(found)
    if options.plot:
        plot(found, options.plot)


if __name__ == "__main__":
    main()
