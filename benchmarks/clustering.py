"""Clustering: seconds, memory and agreement by number of points, and quality against ground truth by its distances.

    python benchmarks/clustering.py speed [--sizes 2000 20000 100000 300000 1000000] [--library-to 100000]
    python benchmarks/clustering.py quality [--scene SCENE ...] [--gaussians 20000 80000 300000]

`speed` takes all furniture of a generated apartment of 8 rooms as one category, the hardest kind: hundreds of objects.
Each method runs in a process of its own, whose peak memory it reports. `library` is the hdbscan package.
`quality` clusters each category but walls, floors and ceilings. CPU seconds of one thread.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from pipeline.metrics.cluster_quality import ClusterQuality, adjusted_rand, apart, cluster_quality
from pipeline.query.cluster import ClusterConfig, cluster_points, with_distances
from pipeline.scene import Scene
from pipeline.scene.load import load_scene
from pipeline.scene.procedural.build import build_apartment

SURFACES = ("wall", "floor", "ceiling")
ROOMS = ((5, 1), (1, 4), (2, 4), (6, 8))
"""Seeds and rooms of the generated apartments."""

RULES = {
    "fixed 0.2 m": ClusterConfig(epsilon_m=0.2, noise_join_m=0.3),
    "fixed 0.1 m": ClusterConfig(epsilon_m=0.1, noise_join_m=0.15),
    "fixed 0.4 m": ClusterConfig(epsilon_m=0.4, noise_join_m=0.6),
    "derived": ClusterConfig(),
}


def library(points: np.ndarray, config: ClusterConfig) -> np.ndarray:
    """Return the labels of the hdbscan package; noise is left alone."""
    from hdbscan import HDBSCAN

    model = HDBSCAN(
        min_cluster_size=config.min_cluster_size,
        min_samples=config.min_samples,
        cluster_selection_epsilon=config.epsilon_m,
        algorithm="boruvka_kdtree",
        approx_min_span_tree=False,
        core_dist_n_jobs=1,
        allow_single_cluster=True,
    )
    return np.asarray(model.fit_predict(points - points.mean(axis=0)))


def speed(sizes: list[int], library_to: int) -> None:
    """Print a line for each size and method."""
    scene = build_apartment(3, rooms=8, gaussians=max(20_000, round(1.5 * max(sizes))), views=1).scene
    every = scene.gaussians.means[_furniture(scene)].astype(np.float64)
    rng = np.random.default_rng(0)
    print(f"{'points':>9}  {'method':<22}{'CPU s':>8}{'MB more':>9}{'clusters':>9}{'ARI to exact':>13}")
    for size in sizes:
        points = every[np.sort(rng.choice(len(every), min(size, len(every)), replace=False))]
        epsilon = with_distances(points, ClusterConfig()).epsilon_m
        assert epsilon is not None
        exact = ClusterConfig(epsilon_m=epsilon, noise_join_m=0.0)
        methods: dict[str, tuple[Callable[..., np.ndarray], ClusterConfig]] = {"exact": (cluster_points, exact)}
        for part in (4, 2):
            thinned = exact.model_copy(update={"voxel_m": epsilon / part})
            methods[f"cubes of epsilon / {part}"] = (cluster_points, thinned)
        if size <= library_to:
            methods["library"] = (library, exact)
        expected = None
        for name, (function, config) in methods.items():
            labels, seconds, more = _alone(function, points, config)
            expected = labels if expected is None else expected
            agreement = adjusted_rand(apart(expected), apart(labels))
            count = int(labels.max()) + 1
            print(f"{len(points):>9,}  {name:<22}{seconds:>8.2f}{more:>9.0f}{count:>9}{agreement:>13.6f}", flush=True)


def _alone(
    function: Callable[..., np.ndarray], points: np.ndarray, config: ClusterConfig
) -> tuple[np.ndarray, float, float]:
    """Run in a fresh process, warmed up; return labels, seconds and how far memory rose, MB."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_timed, (function, points, config))


def _timed(
    function: Callable[..., np.ndarray], points: np.ndarray, config: ClusterConfig
) -> tuple[np.ndarray, float, float]:
    function(np.random.default_rng(0).normal(size=(500, 3)), config)
    before = _peak_mb()
    start = time.thread_time()
    labels = function(points, config)
    seconds = time.thread_time() - start
    return labels, seconds, _peak_mb() - before


def _peak_mb() -> float:
    """Peak memory of this process. Linux's ru_maxrss would be that of the parent where it was larger."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 / 1024  # macOS counts bytes


def _furniture(scene: Scene) -> np.ndarray:
    assert scene.semantics.category is not None
    surfaces = [number for number, name in enumerate(scene.semantics.vocabulary) if name in SURFACES]
    return ~np.isin(scene.semantics.category, [-1, *surfaces])


def quality(paths: list[str], counts: list[int]) -> None:
    """Print a line for each scene and rule, and one for all scenes."""
    print(f"{'scene':<22}{'rule':<13}{'ARI':>7}{'matched':>13}{'split':>7}{'merged':>8}{'dropped':>9}")
    totals: dict[str, list[ClusterQuality]] = {rule: [] for rule in RULES}
    for name, scene in _scenes(paths, counts):
        for rule, config in RULES.items():
            found = [_measure(scene, category, config) for category in _categories(scene)]
            totals[rule] += found
            _line(name, rule, found)
    for rule, found in totals.items():
        _line("all", rule, found)


def _scenes(paths: list[str], counts: list[int]) -> Iterator[tuple[str, Scene]]:
    for path in paths:
        yield Path(path).name, load_scene(path)
    for seed, rooms in ROOMS:
        for count in counts:
            name = f"{rooms} rooms ({seed}), {count // 1000}k"
            yield name, build_apartment(seed, rooms=rooms, gaussians=count, views=1).scene


def _categories(scene: Scene) -> list[int]:
    """Categories that some Gaussian of known instance carries."""
    category, instance = scene.semantics.category, scene.semantics.instance
    assert category is not None
    assert instance is not None
    return [int(number) for number in np.unique(category[_furniture(scene) & (instance >= 0)])]


def _measure(scene: Scene, category: int, config: ClusterConfig) -> ClusterQuality:
    ids = np.flatnonzero(scene.semantics.category == category)
    assert scene.semantics.instance is not None
    labels = cluster_points(scene.gaussians.means[ids], config)
    return cluster_quality(scene.semantics.instance[ids], labels)


def _line(scene: str, rule: str, found: list[ClusterQuality]) -> None:
    aris = [one.ari for one in found if one.ari is not None]
    matched, instances = sum(one.matched for one in found), sum(one.instances for one in found)
    split, merged = sum(one.over_split for one in found), sum(one.under_split for one in found)
    dropped = sum(one.dropped for one in found) / max(1, sum(one.points for one in found))
    ratio = f"{matched}/{instances}"
    print(f"{scene:<22}{rule:<13}{np.mean(aris):>7.3f}{ratio:>13}{split:>7}{merged:>8}{dropped:>9.1%}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    fast = verbs.add_parser("speed")
    fast.add_argument("--sizes", type=int, nargs="+", default=[2_000, 20_000, 100_000, 300_000, 1_000_000])
    fast.add_argument("--library-to", type=int, default=100_000, help="largest size the hdbscan package is run at")
    good = verbs.add_parser("quality")
    good.add_argument("--scene", nargs="*", default=[], help="scene folders with instances")
    good.add_argument("--gaussians", type=int, nargs="*", default=[20_000, 80_000, 300_000])
    args = parser.parse_args()
    if args.verb == "speed":
        speed(args.sizes, args.library_to)
    else:
        quality(args.scene, args.gaussians)


if __name__ == "__main__":
    main()
