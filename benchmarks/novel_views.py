"""Milliseconds of a question's view stages on a warm scene: view choice, poses, pictures, measures, and the search.

    python benchmarks/novel_views.py SCENE [--questions 20] [--clusters 3] [--threads 2]

A question is a few clusters that were not asked for before: balls of Gaussians, so that scenes without categories can
be measured, too. CPU is the time of one thread, which does not depend on what else the machine does; wall is with
`--threads` renders side by side.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from visibility import balls

from pipeline.config import MethodConfig
from pipeline.query.initial_views import initial_views
from pipeline.query.perturb import novel_poses
from pipeline.query.view_quality import view_quality
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext

POLICIES = {
    "perturb V=4": {"count": 4},
    "explore V=1": {"policy": "explore", "count": 1},
    "explore V=4": {"policy": "explore", "count": 4},
}


class Stages:
    """Adds up the seconds of a question's stages and keeps the sums of every question."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock, self.now = clock, defaultdict[str, float](float)
        self.questions: list[dict[str, float]] = []

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block."""
        start = self.clock()
        yield
        self.now[name] += self.clock() - start

    def ask(self) -> None:
        """End a question."""
        self.questions.append({**self.now, "total": sum(self.now.values())})
        self.now.clear()

    def show(self, title: str) -> None:
        """Print the median of every stage, milliseconds."""
        names = list(dict.fromkeys(name for question in self.questions for name in question if name != "total"))
        names.append("total")
        medians = [1e3 * float(np.median([q.get(name, 0.0) for q in self.questions])) for name in names]
        print(f"  {title:24s}" + "  ".join(f"{n} {m:.0f}" for n, m in zip(names, medians, strict=True)))


def measure(context: SceneContext, config: MethodConfig, questions: list[list[np.ndarray]], stages: Stages) -> None:
    """Take every question through the stages."""
    index, book = context.index(config.visibility), context.pictures(config.images)
    means, up, novel = context.scene.gaussians.means, context.scene.up, config.novel_views
    for clusters in questions:
        with stages.stage("choose"):
            chosen = initial_views(index.counts(clusters))
        for cluster, view in zip(clusters, chosen, strict=True):
            if view.view is None:
                continue
            camera = context.scene.views[view.view].camera
            if novel.policy == "explore":
                with stages.stage("explore"):
                    cameras = [camera, *context.explorer(config).explore(cluster, camera, novel.count)]
            else:
                with stages.stage("probe"):
                    free = context.free_distances(view.view, novel)
                    poses = novel_poses(context.gaussians, camera, means[cluster].mean(axis=0), up, novel, free)
                    cameras = [camera, *(pose.camera for pose in poses)]
            with stages.stage("pictures"):
                pictures = book.render_all(cameras, [None] * len(cameras))
            with stages.stage("measure"):
                seen = context.times_seen(config)
                for picture, pose in zip(pictures, cameras, strict=True):
                    view_quality(picture.footprint, pictures[0].footprint, cluster, means, pose, seen)
        stages.ask()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="scene folder or URI")
    parser.add_argument("--questions", type=int, default=20)
    parser.add_argument("--clusters", type=int, default=3, help="clusters of a question")
    parser.add_argument("--radius", type=float, default=0.3, help="radius of a cluster, metres")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    scene = load_scene(args.scene)
    lens = scene.views[0].camera
    print(f"{len(scene.gaussians):,} Gaussians, {len(scene.views)} views of {lens.width} x {lens.height}")
    drawn = balls(scene, args.questions * args.clusters, args.radius, np.random.default_rng(0))
    questions = [drawn[start : start + args.clusters] for start in range(0, len(drawn), args.clusters)]
    index = None
    for threads, clock, name in ((1, time.thread_time, "CPU"), (args.threads, time.perf_counter, "wall")):
        for policy, settings in POLICIES.items():
            config = MethodConfig.model_validate({"novel_views": settings})
            context = SceneContext(scene, threads=threads)
            own = context.index(config.visibility)
            if index is None:
                own.build()
                index = own.joined()
            own.adopt_transposed(index)
            start = clock()
            context.times_seen(config)
            explores = config.novel_views.policy == "explore"
            if explores:
                context.explorer(config).prepare()
            once = clock() - start
            measure(context, config, questions[:1], Stages(clock))  # compiles, and touches memory first
            stages = Stages(clock)
            measure(context, config, questions[1:], stages)
            stages.show(f"{policy}, {name}")
            if explores:
                print(f"  {'':24s}map of free space and of what was seen, once a scene: {once:.1f} s")


if __name__ == "__main__":
    main()
