"""What choosing views without the whole index skips: renders, tiles, Gaussians and time, with equal choices asserted.

    python benchmarks/skips.py --rooms 1 2 4 8 --questions 1 10 100
    python benchmarks/skips.py --scene DATA/showroom --clusters 4

Procedural scenes: a question's clusters are the instances of two categories. A scene without categories: each question
has `--clusters` balls of Gaussians around random points (benchmarks/visibility.py). Times are CPU seconds of one
thread, the index of all 300 views and the searches in the same run.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import numpy as np
from visibility import balls

from pipeline.geometry import Camera
from pipeline.query.initial_views import InitialView, initial_views
from pipeline.query.view_bounds import ClusterInViews
from pipeline.query.view_search import best_views
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex, Window
from pipeline.render import PreparedGaussians, prepare
from pipeline.render.culling import visible_blocks
from pipeline.render.prepare import BLOCK
from pipeline.render.window import Window as Pixels
from pipeline.scene import Scene
from pipeline.scene.load import load_scene
from pipeline.scene.procedural import build_apartment

STRUCTURE = {"wall", "floor", "ceiling"}
"""Categories no question is about."""
Question = list[np.ndarray]


class CountedIndex(VisibilityIndex):
    """An index that also counts the Gaussians its renders project, outside of the time measured."""

    def __init__(self, gaussians: PreparedGaussians, cameras: Sequence[Camera], config: VisibilityConfig) -> None:
        super().__init__(gaussians, cameras, config)
        self.projected, self.aside = 0, 0.0

    def _count(self, view: int, window: Window | None = None) -> None:
        start = time.thread_time()
        pixels = Pixels.of(self.cameras[view], window)
        self.projected += BLOCK * len(visible_blocks(self.gaussians, self.lenses[view], pixels, self.config.near_m))
        self.aside += time.thread_time() - start
        super()._count(view, window)


def questions_of(scene: Scene, count: int, clusters: int, rng: np.random.Generator) -> list[Question]:
    """Return the clusters of so many questions."""
    semantics = scene.semantics
    if semantics.category is None or semantics.instance is None:
        found = balls(scene, count * clusters, 0.4, rng)
        return [found[start : start + clusters] for start in range(0, len(found), clusters)]
    names = sorted(set(semantics.present()) - STRUCTURE)
    questions = []
    for _ in range(count):
        numbers = [semantics.vocabulary.index(name) for name in rng.choice(names, 2, replace=False)]
        instances = np.unique(semantics.instance[np.isin(semantics.category, numbers)])
        questions.append([np.flatnonzero(semantics.instance == n).astype(np.int32) for n in instances if n >= 0])
    return questions


def answer(index: CountedIndex, questions: list[Question]) -> tuple[list[tuple[InitialView, ...]], float]:
    """Return the choices of all questions, asked one after another, and the seconds they took."""
    start = time.thread_time()
    chosen = [best_views([ClusterInViews(index, cluster) for cluster in question]) for question in questions]
    return chosen, time.thread_time() - start - index.aside


def measure(label: str, scene: Scene, counts: list[int], clusters: int) -> None:
    """Print one line per number of questions and policy."""
    prepared, cameras = prepare(scene.gaussians), [view.camera for view in scene.views]
    warm = CountedIndex(prepared, cameras, VisibilityConfig(build="lazy"))
    answer(warm, questions_of(scene, 1, clusters, np.random.default_rng(1)))  # compiles
    warm.ids(0)
    whole = CountedIndex(prepared, cameras, VisibilityConfig(build="all"))
    start = time.thread_time()
    whole.build()
    build_s = time.thread_time() - start - whole.aside
    tiles, every = whole.work.tiles, whole.projected
    print(f"\n{label}: {len(prepared):,} Gaussians, {len(cameras)} views of {cameras[0].width} x {cameras[0].height}")
    print(f"whole index: {build_s:.2f} s, {tiles:,} tiles, {every / 1e6:,.1f} M Gaussians projected")
    print("questions clusters build   renders views skipped tiles skipped Gaussians skipped   seconds  of whole")
    for count in counts:
        questions = questions_of(scene, count, clusters, np.random.default_rng(count))
        truth = [initial_views(whole.counts(question)) for question in questions]
        for build in ("lazy", "auto"):
            index = CountedIndex(prepared, cameras, VisibilityConfig(build=build))
            chosen, seconds = answer(index, questions)
            assert chosen == truth, "a choice differs from the full evaluation"
            work = index.work
            untouched = sum(not index.part(view).done.any() for view in range(len(cameras)))
            print(
                f"{count:9} {sum(map(len, questions)):8} {build:5} {work.frames + work.windows:9} "
                f"{untouched / len(cameras):13.0%} {max(0.0, 1 - work.tiles / tiles):13.0%} "
                f"{1 - index.projected / every:17.0%} {seconds:9.2f} {seconds / build_s:8.0%}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", help="scene folder or URI, instead of procedural scenes")
    parser.add_argument("--rooms", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--questions", type=int, nargs="+", default=[1, 10, 100])
    parser.add_argument("--clusters", type=int, default=4, help="balls a question, in a scene without categories")
    parser.add_argument("--views", type=int, default=300, help="views of a procedural scene")
    args = parser.parse_args()
    if args.scene:
        scene = load_scene(args.scene)
        measure(scene.name, scene, args.questions, args.clusters)
        return
    for rooms in args.rooms:
        built = build_apartment(3, rooms=rooms, gaussians=60_000 * rooms, views=args.views, width=640, height=480)
        measure(f"{rooms} rooms", built.scene, args.questions, args.clusters)


if __name__ == "__main__":
    main()
