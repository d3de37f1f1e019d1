"""What each lossy policy of the visibility index saves and loses: seconds against choice of view.

    python benchmarks/view_policies.py --scene DATA/showroom [--plot view_policies.png]
    python benchmarks/view_policies.py --rooms 4 --plot docs/images/view_policies.png

Clusters are the instances of a procedural apartment, or balls around random Gaussians (benchmarks/visibility.py). Same:
share of clusters with the view of the exact evaluation. Regret: how much lower S_vis, evaluated exactly, is from the
chosen view than from the best one, as a share of the best; mean and 95th percentile over clusters that are seen at all.
Time: CPU time of one thread for the index, as a share of the exact one; where the top views of all clusters are scored
again at full size, with that ("again": milliseconds a cluster).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from visibility import balls

from pipeline.query.initial_views import InitialView, initial_views
from pipeline.query.view_bounds import ClusterInViews
from pipeline.query.view_search import best_of_top
from pipeline.query.visibility import PRESETS, VisibilityConfig, VisibilityCounts, VisibilityIndex
from pipeline.render import prepare
from pipeline.scene import Scene
from pipeline.scene.load import load_scene
from pipeline.scene.procedural import build_apartment

SAMPLE = 60
"""Views that are timed."""
LONG_SIDES = (480, 320, 240, 160, 80)
TOPS = (1, 2, 3, 5, 10)
CURVES: dict[str, list[dict[str, float]]] = {
    "resolution": [{"long_side": side} for side in LONG_SIDES],
    "320 px, top k exact": [{"long_side": 320, "exact_top": top} for top in TOPS],
    "160 px, top k exact": [{"long_side": 160, "exact_top": top} for top in TOPS],
    "opacity pruning": [{"min_opacity": opacity} for opacity in (0.02, 0.05, 0.1, 0.2, 0.5)],
    "every n-th view": [{"every_nth": n} for n in (2, 3, 4, 8)],
    "farthest views": [{"most_views": n} for n in (150, 100, 75, 38)],
    "preset fast": [PRESETS["fast"].model_dump(exclude_defaults=True)],
}
"""Settings of each curve, in order."""


@dataclass(frozen=True, slots=True)
class Point:
    """One policy against the exact evaluation."""

    label: str
    """The settings."""
    share: float
    """Time of the index and of what is scored again, as a share of the exact index."""
    again_ms: float
    """Of that, milliseconds a cluster to score again."""
    same: float
    """Share of clusters with the same view."""
    regret: float
    """Mean regret."""
    regret_p95: float
    """Its 95th percentile."""


def compare(label: str, share: float, again_ms: float, chosen: Sequence[InitialView], exact: VisibilityCounts) -> Point:
    """Return how the choices stand against exact counts."""
    scores = exact.scores
    best = scores.max(axis=1)
    seen = best > 0
    got = np.array([0.0 if view.view is None else scores[row, view.view] for row, view in enumerate(chosen)])
    same = np.array([view.view == truth.view for view, truth in zip(chosen, initial_views(exact), strict=True)])
    regret = 1 - got[seen] / best[seen]
    return Point(label, share, again_ms, same[seen].mean(), regret.mean(), float(np.percentile(regret, 95)))


def timed(index: VisibilityIndex, view: int) -> float:
    """Return the seconds that rendering one view takes."""
    start = time.thread_time()
    index.ids(view)
    return time.thread_time() - start


def curves(scene: Scene, clusters: list[np.ndarray]) -> Iterator[tuple[str, list[Point]]]:
    """Yield the points of each curve; the first one is the exact evaluation."""
    prepared, cameras = prepare(scene.gaussians), [view.camera for view in scene.views]
    whole = VisibilityIndex(prepared, cameras, VisibilityConfig())
    whole.build()
    exact = whole.counts(clusters)
    yield "exact", [compare("", 1.0, 0.0, initial_views(exact), exact)]
    for name, settings in CURVES.items():
        points = []
        for setting in settings:
            config = VisibilityConfig.model_validate(setting)
            index = VisibilityIndex(prepared, cameras, config)
            # A sample of views in turn with exact ones: other work on the machine slows both down.
            beside = VisibilityIndex(prepared, cameras, VisibilityConfig())
            sample = index.views[:: max(1, len(index.views) // SAMPLE)]
            pairs = np.array([(timed(index, view), timed(beside, view)) for view in sample])
            share = pairs[:, 0].sum() / pairs[:, 1].sum() * len(index.views) / len(cameras)
            counts, again = index.counts(clusters), 0.0
            if config.exact_top:
                decides = config.model_copy(update={"long_side": None, "exact_top": 0})
                full = VisibilityIndex(prepared, cameras, decides)
                start = time.thread_time()
                chosen = best_of_top([ClusterInViews(full, c) for c in clusters], counts, config.exact_top)
                again = time.thread_time() - start
                share += again / (pairs[:, 1].mean() * len(cameras))
            else:
                chosen = initial_views(counts)
            label = ", ".join(f"{key} {value:g}" for key, value in setting.items())
            points.append(compare(label, share, 1e3 * again / len(clusters), chosen, exact))
        yield name, points


def plot(found: dict[str, list[Point]], title: str, path: Path) -> None:
    """Draw agreement and regret against time."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    for name, points in found.items():
        times = [point.share for point in points]
        style = {"marker": "*" if len(points) == 1 else "o", "ms": 13 if len(points) == 1 else 5, "label": name}
        left.plot(times, [100 * point.same for point in points], **style)
        right.plot(times, [100 * point.regret for point in points], **style)
    left.set(ylabel="clusters with the same view, %", xlabel="time, share of the exact index", ylim=(None, 101))
    right.set(ylabel="mean score regret, %", xlabel="time, share of the exact index", yscale="symlog")
    for axis in (left, right):
        axis.set_xlim(left=0)
        axis.grid(alpha=0.3)
    right.legend(fontsize=8)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    print(f"plot: {path}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", help="scene folder or URI, instead of a procedural apartment")
    parser.add_argument("--rooms", type=int, default=4)
    parser.add_argument("--clusters", type=int, default=100, help="most clusters")
    parser.add_argument("--plot", type=Path)
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    if args.scene:
        scene = load_scene(args.scene)
        clusters = balls(scene, args.clusters, 0.4, rng)
    else:
        size = {"gaussians": 60_000 * args.rooms, "views": 300, "width": 640, "height": 480}
        scene = build_apartment(3, rooms=args.rooms, **size).scene
        instance = scene.semantics.instance
        assert instance is not None
        numbers = rng.permutation(np.unique(instance[instance >= 0]))[: args.clusters]
        clusters = [np.flatnonzero(instance == number).astype(np.int32) for number in numbers]
    title = f"{scene.name}: {len(scene.gaussians):,} Gaussians, {len(scene.views)} views, {len(clusters)} clusters"
    print(title)
    found = {}
    print(f"{'policy':22} {'settings':32}   time  again ms    same  regret     p95")
    for name, points in curves(scene, clusters):
        found[name] = points
        for p in points:
            errors = f"{p.same:6.1%} {p.regret:7.2%} {p.regret_p95:7.2%}"
            print(f"{name:22} {p.label:32} {p.share:6.0%} {p.again_ms:9.1f}  {errors}", flush=True)
    if args.plot:
        plot(found, title, args.plot)


if __name__ == "__main__":
    main()
