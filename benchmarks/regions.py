"""Every region rule on the views that a finished run chose: mIoU, and how much each differs from the paper's frustum.

    splatreasoner demo --scenes 12 --output runs/ablation
    python -m benchmarks.regions runs/ablation/run [--arm verified]

No model is asked: the rules cut the same views. Differences are paired by question; intervals are 95 % bootstraps over
scenes and questions, over questions alone where there is one scene. Milliseconds are CPU time of one thread a question,
without rendering the chosen views.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict

import numpy as np
import pandas as pd

from benchmarks.run_views import GroundedArm, grounded_arms
from pipeline.metrics.significance import bootstrap_interval
from pipeline.tasks.region import OF_CLUSTERS, GroundingConfig
from pipeline.tasks.scoring import score_regions

RULES: dict[str, dict[str, object]] = {
    "frustum": {},
    "visible": {"region": "visible"},
    **{f"depth {metres:g} m": {"region": "depth", "depth_tolerance_m": metres} for metres in (0.1, 0.25, 0.5, 1.0)},
    "cluster": {"region": "cluster"},
    "cluster_in_frustum": {"region": "cluster_in_frustum"},
    "prominent": {"region": "prominent"},
    "instance": {"region": "instance"},
    **{f"{name}, by cluster": {"region": name, "instances": "clusters"} for name in sorted(OF_CLUSTERS)},
}
"""Settings of `method.grounding` by what they are called in the table."""
PAPER = "frustum"


def measure(arm: GroundedArm, settings: dict[str, object]) -> dict[str, float]:
    """Return the score of one rule, how many instances it predicts, and its seconds."""
    config = GroundingConfig.model_validate(settings)
    start = time.thread_time()
    regions = [instance.gaussians for instance in arm.grounder.instances(arm.chosen, config)]
    seconds = time.thread_time() - start
    score = score_regions(arm.context, arm.question, regions, arm.targets, config.weighting)
    assert score.iou is not None
    return {"iou": score.iou, "predicted": len(regions), "seconds": seconds}


def measured(run: str, arm: str) -> pd.DataFrame:
    """Return one row a question and rule."""
    rows = []
    for found in grounded_arms(run):
        if found.arm != arm:
            continue
        measure(found, RULES["instance"])  # renders the views
        for name, settings in RULES.items():
            if "instances" in settings and found.question.task == "ground_one":
                continue
            rows.append(
                {
                    "scene": found.question.scene,
                    "question": found.question.question_id,
                    "task": found.question.task,
                    "rule": name,
                    "run_iou": found.iou,
                    **measure(found, settings),
                }
            )
    return pd.DataFrame(rows)


def interval(values: np.ndarray, scenes: list[str]) -> str:
    """Return a mean of percents with its interval."""
    found = bootstrap_interval(100 * values, scenes, np.random.default_rng(0))
    return f"{found.mean:5.1f} [{found.low:5.1f}, {found.high:5.1f}]"


def show(rows: pd.DataFrame) -> None:
    """Print a table a task."""
    for task, part in rows.groupby("task"):
        wide = part.pivot(index="question", columns="rule", values="iou")
        scenes = part.drop_duplicates("question").set_index("question")["scene"].reindex(wide.index).tolist()
        means = defaultdict(float, part.groupby("rule")["seconds"].mean())
        print(f"\n{task}: {len(wide)} questions of {len(set(scenes))} scenes")
        print(f"{'rule':30} {'mIoU':>20} {'against frustum':>22}  better  worse     ms")
        for rule in (name for name in RULES if name in wide):
            step = (wide[rule] - wide[PAPER]).to_numpy(np.float64)
            print(
                f"{rule:30} {interval(wide[rule].to_numpy(np.float64), scenes)} {interval(step, scenes)} "
                f"{(step > 0).sum():7d} {(step < 0).sum():6d} {1e3 * means[rule]:6.1f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="+", help="run folders; their questions are pooled")
    parser.add_argument("--arm", default="verified", choices=("initial", "final", "verified"))
    args = parser.parse_args()
    rows = pd.concat([measured(run, args.arm) for run in args.run], ignore_index=True)
    paper = rows[rows["rule"] == PAPER]
    apart = int((~np.isclose(paper["iou"], paper["run_iou"], atol=1e-12)).sum())
    print(f"frustum scores that differ from the run's own: {apart} of {len(paper)}")
    show(rows)


if __name__ == "__main__":
    main()
