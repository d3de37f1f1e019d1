"""How time grows: with Gaussians, pixels, footprint, opacity, threads and views; and the memory of 5M Gaussians.

    python -m benchmarks.cost_curves                                      # all curves, up to 1M Gaussians
    python -m benchmarks.cost_curves --largest 5_000_000 --plot docs/images/cost_curves.png
    python -m benchmarks.cost_curves --memory 5_000_000                   # peak memory only

Each curve changes one thing of the synthetic room of `benchmarks/render.py`: 100,000 Gaussians, degree 3, 640 x 480.
Times are the least over the repeats: CPU milliseconds of one thread, but wall milliseconds for the curve of threads.
Memory is the peak of a process that holds the Gaussians, prepares them and renders colour, depth, alpha and dominance.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.render import ROOT, synthetic_room
from pipeline.geometry import Camera
from pipeline.render import OUTPUTS, PreparedGaussians, prepare, render
from pipeline.scene.gaussians import Gaussians

COLOR, DOMINANCE = ("color", "depth", "alpha"), ("dominant",)
BASE = 100_000
CHUNK = 250_000
SIZES = ((160, 120), (320, 240), (640, 480), (1280, 960), (1920, 1080), (3840, 2160))
MEMORY_LIMIT_GB = 3.0

Row = tuple[str, float, float, float]
"""Label, x, colour ms, dominance ms."""


def large_room(count: int) -> tuple[Gaussians, Camera]:
    """The synthetic room put together from parts, so that building it takes little more memory than it has."""
    if count <= CHUNK:
        scene, (camera,) = synthetic_room(count)
        return scene, camera
    shapes = {"means": (3,), "quats": (4,), "log_scales": (3,), "opacity_logits": (), "sh": (16, 3)}
    arrays = {name: np.empty((count, *shape), np.float32) for name, shape in shapes.items()}
    for start in range(0, count, CHUNK):
        size = min(CHUNK, count - start)
        part, (camera,) = synthetic_room(size, seed=start // CHUNK)
        for name, array in arrays.items():
            array[start : start + size] = getattr(part, name)
        # Gaussians grow smaller with their number, as in a room that is trained on more of them.
        arrays["log_scales"][start : start + size] += np.float32(0.5 * np.log(size / count))
    return Gaussians(**arrays), camera


def milliseconds(work: Callable[[], object], repeats: int, clock: Callable[[], float] = time.thread_time) -> float:
    """Least over repeats, after one call that compiles and touches memory: what else runs can only add."""
    work()
    spent = []
    for _ in range(repeats):
        start = clock()
        work()
        spent.append(1e3 * (clock() - start))
    return min(spent)


def both(label: str, x: float, prepared: PreparedGaussians, camera: Camera, repeats: int) -> Row:
    modes = [milliseconds(lambda o=outputs: render(prepared, camera, o), repeats) for outputs in (COLOR, DOMINANCE)]
    return label, x, *modes


def by_gaussians(largest: int, repeats: int) -> list[Row]:
    rows = []
    for count in (10_000, 30_000, 100_000, 300_000, 1_000_000, 2_000_000, 5_000_000):
        if count <= largest:
            scene, camera = large_room(count)
            rows.append(both(f"{count:,}", count, prepare(scene), camera, repeats))
    return rows


def by_pixels(repeats: int) -> list[Row]:
    scene, camera = large_room(BASE)
    prepared = prepare(scene)
    return [both(f"{w} x {h}", w * h, prepared, camera.resized(w, h), repeats) for w, h in SIZES]


def by_footprint(repeats: int) -> list[Row]:
    scene, camera = large_room(BASE)
    rows = []
    for factor in (0.25, 0.5, 1.0, 2.0, 4.0):
        log_scales = scene.log_scales + np.float32(np.log(factor))
        rows.append(both(f"x {factor:g}", factor, prepare(replace(scene, log_scales=log_scales)), camera, repeats))
    return rows


def by_opacity(repeats: int) -> list[Row]:
    scene, camera = large_room(BASE)
    rows = []
    for opacity in (0.02, 0.1, 0.5, 0.9, 0.99):
        logits = np.full(BASE, np.log(opacity / (1 - opacity)), np.float32)
        rows.append(both(f"{opacity:g}", opacity, prepare(replace(scene, opacity_logits=logits)), camera, repeats))
    return rows


def by_threads(repeats: int) -> list[Row]:
    scene, camera = large_room(BASE)
    prepared = prepare(scene)
    rows = []
    for threads in (1, 2, 4):
        modes = [
            milliseconds(
                lambda o=outputs, n=threads: render(prepared, camera, o, threads=n), repeats, time.perf_counter
            )
            for outputs in (COLOR, DOMINANCE)
        ]
        rows.append((f"{threads}", threads, *modes))
    return rows


def by_views(repeats: int) -> list[Row]:
    """Milliseconds a view with the scene prepared once for all of them, on one thread."""
    scene, camera = large_room(BASE)

    def draw(views: int, outputs: tuple[str, ...]) -> None:
        prepared = prepare(scene)
        for _ in range(views):
            render(prepared, camera, outputs)

    rows = []
    for views in (1, 4, 16, 64):
        few = max(1, repeats // 2)
        modes = [milliseconds(lambda o=o, n=views: draw(n, o), few) / views for o in (COLOR, DOMINANCE)]
        rows.append((f"{views}", views, *modes))
    return rows


def peak_gib() -> float:
    """Most memory this process has held. On Linux `ru_maxrss` would count the parent's too, from before the exec."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**30 if sys.platform == "darwin" else 2**20)


def peak_memory(count: int) -> None:
    """Print the peak of this process after rendering `count` Gaussians; exit 1 above the limit."""
    scene, camera = large_room(count)
    held = sum(getattr(scene, name).nbytes for name in ("means", "quats", "log_scales", "opacity_logits", "sh"))
    prepared = prepare(scene)
    for outputs in (OUTPUTS, DOMINANCE):
        render(prepared, camera, outputs)
    peak = peak_gib()
    print(f"memory: {count:,} Gaussians of degree 3 hold {held / 2**30:.2f} GiB; peak of the process {peak:.2f} GiB")
    sys.exit(peak > MEMORY_LIMIT_GB)


def plot(curves: dict[str, list[Row]], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11, 6), constrained_layout=True)
    for axis, (name, rows) in zip(axes.flat, curves.items(), strict=True):
        x = [row[1] for row in rows]
        axis.plot(x, [row[2] for row in rows], "o-", label="colour, depth, alpha", color="tab:blue")
        axis.plot(x, [row[3] for row in rows], "s-", label="dominance only", color="tab:orange")
        axis.set_xlabel(name)
        if name != "opacity of every Gaussian":
            axis.set_xscale("log")
        if name in ("threads", "views of one scene", "standard deviations, factor"):
            axis.set_xticks(x, [row[0].removeprefix("x ") for row in rows])
            axis.minorticks_off()
        if max(row[2] for row in rows) > 10 * min(row[3] for row in rows):
            axis.set_yscale("log")
        else:
            axis.set_ylim(0)
        axis.grid(alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel("milliseconds a view")
    axes[0, 0].legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--largest", type=int, default=1_000_000, help="most Gaussians of the first curve")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--plot", type=Path, help="PNG of the curves")
    parser.add_argument("--memory", type=int, help="only render this many Gaussians and print the peak memory")
    options = parser.parse_args()
    if options.memory:
        peak_memory(options.memory)
    repeats = options.repeats
    measures = {
        "Gaussians": lambda: by_gaussians(options.largest, repeats),
        "pixels": lambda: by_pixels(repeats),
        "standard deviations, factor": lambda: by_footprint(repeats),
        "opacity of every Gaussian": lambda: by_opacity(repeats),
        "threads": lambda: by_threads(repeats),
        "views of one scene": lambda: by_views(repeats),
    }
    curves = {}
    for name, measure in measures.items():
        curves[name] = measure()
        print(f"\n{name:28} {'colour ms':>10} {'dominance ms':>13}")
        for label, _, color, dominance in curves[name]:
            print(f"{label:>28} {color:10.2f} {dominance:13.2f}", flush=True)
    if options.plot:
        plot(curves, options.plot)
    command = [sys.executable, "-m", "benchmarks.cost_curves", "--memory", str(options.largest)]
    print(flush=True)
    sys.exit(subprocess.run(command, cwd=ROOT, check=False).returncode)


if __name__ == "__main__":
    main()
