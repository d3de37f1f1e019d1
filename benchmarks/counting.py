"""Where the count of instances goes wrong, and what merging and splitting clusters does to it.

    python -m benchmarks.counting clusters scenes/apartment-101 scenes/scene0000_00
    python -m benchmarks.counting run runs/ablation/run [--arm verified]
    python -m benchmarks.counting compare runs/ablation/run runs/split

`clusters` takes every category of some scenes but walls, floors and ceilings: instances matched (IoU above 0.5), split
over clusters and merged into one, by HDBSCAN alone and after each policy; seconds of CPU time of one thread, without
the visibility index. `run` follows the multi-target questions of a finished run from the targets to the predicted
count: a target may share its cluster, its cluster may share a view, and the model may misjudge a view. `compare` sets
two finished runs of the same questions against each other, with regions cut by the same rules.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from benchmarks.cluster_policies import in_order, merge_by_shared_views, split_by_footprint
from benchmarks.regions import interval, measured
from benchmarks.run_views import GroundedArm, grounded_arms
from pipeline.config import MethodConfig
from pipeline.metrics.cluster_quality import cluster_quality
from pipeline.metrics.count_error import count_error
from pipeline.query.initial_views import initial_views
from pipeline.query.split_clusters import split_cluster
from pipeline.render import render
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from pipeline.tasks.region import GroundingConfig

LEFT_OUT = ("wall", "floor", "ceiling")
Clusters = tuple[np.ndarray, ...]
Policy = Callable[[SceneContext, Clusters, float], Clusters]


def merged(gap: float, shared: float) -> Policy:
    """Return the policy that merges over gaps of so many epsilons."""

    def policy(context: SceneContext, clusters: Clusters, epsilon_m: float) -> Clusters:
        counts = context.index(MethodConfig().visibility).counts(clusters)
        return merge_by_shared_views(clusters, context.scene.gaussians.means, counts, gap * epsilon_m, shared)

    return policy


def split(step: float) -> Policy:
    """Return the policy that splits where links are longer than so many epsilons."""

    def policy(context: SceneContext, clusters: Clusters, epsilon_m: float) -> Clusters:
        views = initial_views(context.index(MethodConfig().visibility).counts(clusters))
        found: list[np.ndarray] = []
        for cluster, view in zip(clusters, views, strict=True):
            if view.view is None:
                found.append(cluster)
                continue
            image = render(context.gaussians, context.scene.views[view.view].camera, ("dominant",))
            assert image.dominant is not None
            found += split_by_footprint(cluster, context.scene.gaussians.means, image.dominant, step * epsilon_m)
        return in_order(found)

    return policy


def linked(step: float) -> Policy:
    """Return the policy that splits where links are longer than so many epsilons, whatever views show."""
    least = MethodConfig().clustering.min_cluster_size

    def policy(context: SceneContext, clusters: Clusters, epsilon_m: float) -> Clusters:
        means = context.scene.gaussians.means
        return in_order([part for ids in clusters for part in split_cluster(ids, means, step * epsilon_m, least)])

    return policy


POLICIES: dict[str, Policy] = {
    "none": lambda _, clusters, __: clusters,
    "merge: gap 1.5, shared 0.5": merged(1.5, 0.5),
    "merge: gap 1.5, shared 0.8": merged(1.5, 0.8),
    "merge: gap 3, shared 0.8": merged(3.0, 0.8),
    **{f"split: footprint, step {step}": split(step) for step in (0.35, 0.5, 0.7)},
    **{f"split: links, step {step}": linked(step) for step in (0.35, 0.5, 0.6, 0.7, 0.8)},
}


def of_scenes(scenes: Sequence[str]) -> None:
    """Print a row a policy."""
    total: dict[str, Counter[str]] = {name: Counter() for name in POLICIES}
    config, wrong = MethodConfig(), Counter[str]()
    for uri in scenes:
        context = SceneContext(load_scene(uri))
        context.index(config.visibility).build()
        instance = context.scene.semantics.instance
        if instance is None:
            raise SystemExit(f"{uri} has no instances")
        for category in context.vocabulary:
            if category.rsplit(" ", 1)[-1] in LEFT_OUT:
                continue
            ids, before = context.activation(category, config.activation).ids, context.clusters(category, config)
            measured = context.measured_clusters(category, config)
            if measured.quality.over_split or measured.quality.under_split:
                wrong[category] += measured.quality.over_split + measured.quality.under_split
            for name, policy in POLICIES.items():
                start = time.thread_time()
                after = policy(context, before, measured.epsilon_m)
                seconds = time.thread_time() - start
                labels = np.full(len(ids), -1)
                for number, cluster in enumerate(after):
                    labels[np.searchsorted(ids, cluster)] = number
                quality = cluster_quality(instance[ids], labels)
                total[name].update(
                    instances=quality.instances, clusters=quality.clusters, matched=quality.matched,
                    split=quality.over_split, merged=quality.under_split, categories=1, ms=1e3 * seconds,
                    wrong_count=abs(quality.clusters - quality.instances),
                )  # fmt: skip
    print(f"{'policy':28} instances clusters matched split merged  |clusters - instances|  ms a category")
    for name, sums in total.items():
        print(
            f"{name:28} {sums['instances']:9d} {sums['clusters']:8d} {sums['matched']:7d} {sums['split']:5d} "
            f"{sums['merged']:6d} {sums['wrong_count']:23d} {sums['ms'] / sums['categories']:14.1f}"
        )
    print("categories split or merged by HDBSCAN:", ", ".join(f"{name} {n}" for name, n in wrong.most_common(12)))


def steps(arm: GroundedArm) -> dict[str, int]:
    """Return the counts of one question, from its targets to its prediction."""
    instance = arm.context.scene.semantics.instance
    assert instance is not None
    wanted = set(arm.question.target_ids or ())
    activated = np.isin(instance, list(wanted)) & np.isin(np.arange(len(instance)), arm.grounder.activated)
    fits = [_main(instance[ids]) in wanted for ids in arm.clusters]
    own = [view.own for view in arm.views]
    said_yes = {view.id for view in arm.chosen}
    fitting = [any(fits[number] for number in numbers) for numbers in own]
    yes = [view.id in said_yes for view in arm.views]
    prominent = arm.grounder.instances(arm.chosen, GroundingConfig(region="prominent"))
    filling = {instance.gaussians.tobytes() for instance in prominent}
    return {
        "targets": len(wanted),
        "targets activated": len(np.unique(instance[activated])),
        "clusters of targets": sum(_main(instance[ids]) in wanted for ids in arm.found),
        "clusters kept": sum(fits),
        "views of those": sum(fitting),
        "views said to show one": sum(yes),
        "missed": sum(fit and not said for fit, said in zip(fitting, yes, strict=True)),
        "false": sum(said and not fit for fit, said in zip(fitting, yes, strict=True)),
        "clusters of those views": sum(len(numbers) for numbers, said in zip(own, yes, strict=True) if said),
        "clusters that fill them": len(filling),
    }


def _main(instances: np.ndarray) -> int:
    """The instance most of a cluster belongs to."""
    known = instances[instances >= 0]
    return int(np.bincount(known).argmax()) if len(known) else -1


def of_run(run: str, arm: str) -> None:
    """Print where the count of a run's questions goes wrong."""
    rows = [steps(found) for found in grounded_arms(run) if found.arm == arm and found.question.task == "ground_many"]
    print(f"{len(rows)} multi-target questions, arm {arm}; a perfect model would say yes to the views of targets")
    print(f"{'counted':26} {'sum':>5} {'|error|':>8} {'bias':>7} {'exact':>6}")
    targets = [row["targets"] for row in rows]
    for name in rows[0]:
        counts = [row[name] for row in rows]
        if name in ("missed", "false"):
            print(f"{'  views ' + name:26} {sum(counts):5d}")
            continue
        error = count_error(counts, targets)
        print(f"{name:26} {sum(counts):5d} {error.mean_absolute:8.3f} {error.bias:+7.3f} {error.exact:6.1%}")


def of_two(before: str, after: Sequence[str], arm: str) -> None:
    """Print scores and counts before and after, by rule, over the questions answered in both."""
    rows = measured(before, arm), pd.concat([measured(run, arm) for run in after])
    found = [part.set_index(["question", "rule"]) for part in rows]
    both = found[0].join(found[1], how="inner", suffixes=("", "_after"))
    names = np.unique(both["scene"]).tolist()
    wanted = {a.question.question_id: len(a.targets) for a in grounded_arms(before)}
    for (task, rule), part in both.groupby(["task", "rule"], sort=False):
        scenes = part["scene"].tolist()
        step = (part["iou_after"] - part["iou"]).to_numpy(np.float64)
        means = f"{100 * part['iou'].mean():5.1f} {100 * part['iou_after'].mean():5.1f} {interval(step, scenes)}"
        line = f"{task:12} {rule:30} {len(part):4d} {means}"
        if task == "ground_many":
            targets = [wanted[question] for question, _ in part.index]
            for column in ("predicted", "predicted_after"):
                error = count_error([int(count) for count in part[column]], targets)
                line += f"   {error.mean_absolute:.3f} {error.bias:+.3f} {error.exact:.1%}"
        print(line)
    print(f"questions, mIoU of both, difference; many: |count error|, bias, exact of both. Scenes: {', '.join(names)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("clusters").add_argument("scene", nargs="+", help="scene folders with instances")
    run = commands.add_parser("run")
    run.add_argument("run", help="run folder")
    run.add_argument("--arm", default="verified", choices=("initial", "final", "verified"))
    two = commands.add_parser("compare")
    two.add_argument("before", help="run folder")
    two.add_argument("after", nargs="+", help="run folders, of which each has other questions")
    two.add_argument("--arm", default="verified", choices=("initial", "final", "verified"))
    args = parser.parse_args()
    if args.command == "clusters":
        of_scenes(args.scene)
    elif args.command == "compare":
        of_two(args.before, args.after, args.arm)
    else:
        of_run(args.run, args.arm)


if __name__ == "__main__":
    main()
