"""What each way to render faster costs in error: one line a knob, and the Pareto plot of them all.

    python -m benchmarks.error_vs_time                      # a generated apartment
    python -m benchmarks.error_vs_time --scene showroom     # real data, where it lies
    python -m benchmarks.error_vs_time --plot docs/images/error_vs_time.png

Truth is our own exact frame (the default), which `benchmarks/render.py` holds to float64 (more than 100 dB, where every
knob costs far more). Times are CPU milliseconds on one thread: the knobs take turns, each view keeps its least time
over the rounds, and the median over views is shown. A knob is a `RenderQuality`, or a change of the scene. The size of
tiles and the degree of the exponential's polynomial are fixed when kernels are compiled: such a variant runs in a
process of its own, in turns with a process that draws the exact frame, and its ratios are to that one's times.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.error_points import plot, table
from benchmarks.kernel_variants import EXACT_KERNELS, VARIANTS, VariantProcess, variant_processes
from benchmarks.knobs import KNOBS, Turned
from benchmarks.render import showroom
from benchmarks.render_errors import Errors, Point, clusters_of, compare, scores
from pipeline.geometry import Camera
from pipeline.render import EXACT
from pipeline.scene.gaussians import Gaussians


def apartment(views: int, gaussians: int) -> tuple[Gaussians, list[Camera]]:
    from pipeline.scene.procedural import build_apartment

    scene = build_apartment(0, gaussians=gaussians, views=views, width=640, height=480, sh_degree=3).scene
    return scene.gaussians, [view.camera for view in scene.views]


def points_of(
    names: Sequence[str], timers: Sequence[Turned | VariantProcess], errors: Sequence[Errors], views: int, rounds: int
) -> list[Point]:
    """Time all in turns; ratios are to the first."""
    least = np.full((len(timers), 2, views), np.inf)
    for _ in range(rounds):
        for k, timer in enumerate(timers):
            least[k] = np.minimum(least[k], timer.times())
    middle = np.median(least, axis=2)
    return [Point(name, *map(float, (*middle[k], *(middle[k] / middle[0]))), errors[k]) for k, name in enumerate(names)]


def measure(scene: Gaussians, cameras: list[Camera], rounds: int) -> list[Point]:
    """A point a knob and one a variant of the kernels, the exact frames first."""
    stored, clusters = scene.sh_degree, clusters_of(scene)
    knobs = [k for k in KNOBS if k.quality.sh_degree == EXACT.sh_degree or k.quality.sh_degree < stored]
    timers = [Turned(knob, scene, cameras) for knob in knobs]
    truth = timers[0].frames()
    truth["scores"] = scores(truth["dominant"], clusters, len(scene))
    errors = [compare(timer.frames(), truth, clusters, len(scene)) for timer in timers]
    print("  compared; timing", file=sys.stderr, flush=True)
    points = points_of([knob.name for knob in knobs], timers, errors, len(cameras), rounds)
    del timers
    print("  kernel variants", file=sys.stderr, flush=True)
    with variant_processes((EXACT_KERNELS, *VARIANTS), scene, cameras) as processes:
        errors = [compare(process.frames(), truth, clusters, len(scene)) for process in processes]
        names = [process.name for process in processes]
        return points + points_of(names, processes, errors, len(cameras), 2 * rounds)[1:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=("apartment", "showroom"), default="apartment")
    parser.add_argument("--gaussians", type=int, default=200_000, help="size of the apartment")
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=6, help="times every view is drawn by every knob")
    parser.add_argument("--plot", type=Path, help="PNG of the Pareto plot")
    options = parser.parse_args()
    if options.scene == "apartment":
        scene, cameras = apartment(options.views, options.gaussians)
    else:
        scene, cameras = showroom(options.views)
    title = (
        f"{options.scene}, {len(scene):,} Gaussians, {len(cameras)} views of {cameras[0].width} x {cameras[0].height}"
    )
    print(title, flush=True)
    points = measure(scene, cameras, options.rounds)
    print(table(points))
    if options.plot:
        plot(points, options.plot, title)


if __name__ == "__main__":
    main()
