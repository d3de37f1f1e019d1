"""What each way to render faster costs in error: one line a knob, and the Pareto plot of them all.

    python -m benchmarks.error_vs_time                      # a generated apartment
    python -m benchmarks.error_vs_time --scene showroom     # real data, where it lies
    python -m benchmarks.error_vs_time --plot docs/images/error_vs_time.png

Truth is our own exact frame (the default), which `benchmarks/render.py` holds to float64 (more than 100 dB, where every
knob costs far more). Times are CPU milliseconds on one thread: the knobs take turns, each view keeps its least time
over the rounds, and the median over views is shown. A knob is a `RenderQuality`, or a change of the scene. Tile size
(the block masks are built on 16 x 16) and degree of the exponential's polynomial are fixed when kernels are written.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.render import psnr_db, showroom
from pipeline.geometry import Camera
from pipeline.render import EXACT, FAST, RenderQuality, prepare, render
from pipeline.scene.gaussians import Gaussians

CLUSTERS, CLUSTER_RADIUS_M = 300, 0.4
COLOR, DOMINANCE = ("color", "depth", "alpha"), ("dominant",)
BEST_DB = 120.0
"""Equal images are shown with this PSNR."""


@dataclass(frozen=True, slots=True)
class Knob:
    """One way to trade error for time."""

    name: str
    quality: RenderQuality = EXACT
    half: tuple[str, ...] = ()
    """Attributes rounded to float16."""


KNOBS = (
    Knob("exact"),
    Knob("preset fast", FAST),
    Knob("resolution 3/4", RenderQuality(scale=0.75)),
    Knob("resolution 1/2", RenderQuality(scale=0.5)),
    Knob("resolution 1/3", RenderQuality(scale=1 / 3)),
    Knob("resolution 1/4", RenderQuality(scale=0.25)),
    Knob("SH degree 2", RenderQuality(sh_degree=2)),
    Knob("SH degree 1", RenderQuality(sh_degree=1)),
    Knob("SH degree 0", RenderQuality(sh_degree=0)),
    Knob("opacity >= 0.02", RenderQuality(min_opacity=0.02)),
    Knob("opacity >= 0.05", RenderQuality(min_opacity=0.05)),
    Knob("opacity >= 0.1", RenderQuality(min_opacity=0.1)),
    Knob("opacity >= 0.2", RenderQuality(min_opacity=0.2)),
    Knob("float16 scale, turn, opacity", half=("quats", "log_scales", "opacity_logits")),
    Knob("float16 colour", half=("sh",)),
    Knob("float16 means", half=("means",)),
    Knob("alpha >= 2/255", RenderQuality(alpha_min=2 / 255)),
    Knob("alpha >= 4/255", RenderQuality(alpha_min=4 / 255)),
    Knob("alpha >= 8/255", RenderQuality(alpha_min=8 / 255)),
    Knob("stop at T < 1e-3", RenderQuality(transmittance_stop=1e-3)),
    Knob("stop at T < 1e-2", RenderQuality(transmittance_stop=1e-2)),
    Knob("stop at T < 4e-2", RenderQuality(transmittance_stop=4e-2)),
    Knob("alpha 2/255, T 1e-2", RenderQuality(alpha_min=2 / 255, transmittance_stop=1e-2)),
    Knob("alpha 4/255, T 4e-2", RenderQuality(alpha_min=4 / 255, transmittance_stop=4e-2)),
    Knob("fast at 1/2", FAST.model_copy(update={"scale": 0.5})),
)


@dataclass(frozen=True, slots=True)
class Errors:
    """What one knob got wrong."""

    psnr_db: float
    ssim: float
    same_dominant: float
    score_error: float
    """Mean |S_vis - exact S_vis| over clusters and views that see them."""
    same_best_view: float
    """Share of clusters whose best view stays the same."""
    regret: float
    """Mean relative loss of S_vis by taking the best view this knob names."""


@dataclass(frozen=True, slots=True)
class Point:
    """What one knob measured, over all views."""

    name: str
    color_ms: float
    dominance_ms: float
    errors: Errors


def apartment(views: int, gaussians: int) -> tuple[Gaussians, list[Camera]]:
    from pipeline.scene.procedural import build_apartment

    scene = build_apartment(0, gaussians=gaussians, views=views, width=640, height=480, sh_degree=3).scene
    return scene.gaussians, [view.camera for view in scene.views]


def clusters_of(scene: Gaussians) -> list[np.ndarray]:
    """Balls around random visible Gaussians: the scores then depend on nothing but geometry."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(0)
    centres = rng.choice(np.flatnonzero(scene.opacity_logits > 0), CLUSTERS, replace=False)
    found = cKDTree(scene.means).query_ball_point(scene.means[centres], CLUSTER_RADIUS_M)
    return [np.array(ids, np.int64) for ids in found]


def scores(dominant: np.ndarray, clusters: list[np.ndarray], count: int) -> np.ndarray:
    """S_vis, clusters x views."""
    table = np.zeros((len(clusters), len(dominant)))
    for view, image in enumerate(dominant):
        seen = np.zeros(count + 1, bool)
        seen[image] = True
        table[:, view] = [seen[ids].mean() for ids in clusters]
    return table


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Structural similarity: Gaussian window of 1.5 px, data range 1, mean over pixels and channels (Wang 2004)."""
    from scipy.ndimage import gaussian_filter

    def smooth(image: np.ndarray) -> np.ndarray:
        return gaussian_filter(image, (1.5, 1.5, 0), truncate=3.5)

    a, b = np.clip(a, 0, 1).astype(np.float64), np.clip(b, 0, 1).astype(np.float64)
    mean_a, mean_b = smooth(a), smooth(b)
    var_a, var_b = smooth(a * a) - mean_a**2, smooth(b * b) - mean_b**2
    both = smooth(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    top = (2 * mean_a * mean_b + c1) * (2 * both + c2)
    return float(np.mean(top / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))))


class Turned:
    """A scene with one knob turned: its frames, and how long they take."""

    def __init__(self, knob: Knob, scene: Gaussians, cameras: list[Camera]) -> None:
        arrays = {name: getattr(scene, name) for name in ("means", "quats", "log_scales", "opacity_logits", "sh")}
        for name in knob.half:
            arrays[name] = arrays[name].astype(np.float16).astype(np.float32)
        self._prepared, self._quality, self._cameras = prepare(Gaussians(**arrays)), knob.quality, cameras

    def _draw(self, camera: Camera, outputs: tuple[str, ...]):
        return render(self._prepared, camera, outputs, quality=self._quality)

    def frames(self) -> dict[str, np.ndarray]:
        """Colour and dominance of every view on the full grid."""
        color = [self._draw(camera, COLOR).color for camera in self._cameras]
        dominant = [self._draw(camera, DOMINANCE).dominant for camera in self._cameras]
        return {"color": np.array(color), "dominant": np.array(dominant)}

    def times(self) -> np.ndarray:
        """CPU milliseconds, (2, views): colour, dominance."""
        spent = np.zeros((2, len(self._cameras)))
        for mode, outputs in enumerate((COLOR, DOMINANCE)):
            for view, camera in enumerate(self._cameras):
                start = time.thread_time()
                self._draw(camera, outputs)
                spent[mode, view] = 1e3 * (time.thread_time() - start)
        return spent


def compare(found: dict, truth: dict, clusters: list[np.ndarray], count: int) -> Errors:
    exact, ours = truth["scores"], scores(found["dominant"], clusters, count)
    rows = np.flatnonzero(exact.max(axis=1) > 0)
    chosen, best = ours[rows].argmax(axis=1), exact[rows].argmax(axis=1)
    top = exact[rows, best]
    pairs = list(zip(found["color"], truth["color"], strict=True))
    return Errors(
        psnr_db=float(np.mean([psnr_db(np.clip(a, 0, 1), np.clip(b, 0, 1)) for a, b in pairs])),
        ssim=float(np.mean([ssim(a, b) for a, b in pairs])),
        same_dominant=float(np.mean(found["dominant"] == truth["dominant"])),
        score_error=float(np.abs(ours - exact)[exact > 0].mean()),
        same_best_view=float(np.mean(exact[rows, chosen] == top)),
        regret=float(np.mean((top - exact[rows, chosen]) / top)),
    )


def table(points: list[Point]) -> str:
    exact = points[0]
    lines = [
        f"{'knob':30} {'colour ms':>9} {'ratio':>6} {'dominance':>9} {'ratio':>6} {'PSNR dB':>8} {'SSIM':>7} "
        f"{'same id':>9} {'|dS|':>7} {'best view':>9} {'regret':>7}"
    ]
    for p in points:
        e = p.errors
        lines.append(
            f"{p.name:30} {p.color_ms:9.2f} {p.color_ms / exact.color_ms:6.2f} {p.dominance_ms:9.2f} "
            f"{p.dominance_ms / exact.dominance_ms:6.2f} {min(e.psnr_db, BEST_DB):8.1f} {e.ssim:7.4f} "
            f"{100 * e.same_dominant:7.2f} % {e.score_error:7.4f} {100 * e.same_best_view:7.1f} % "
            f"{100 * e.regret:5.2f} %"
        )
    return "\n".join(lines)


def pareto_front(time: np.ndarray, error: np.ndarray) -> list[int]:
    """Points that no other point beats in one without losing in the other."""
    return [
        k
        for k in range(len(time))
        if not ((time <= time[k]) & (error <= error[k]) & ((time < time[k]) | (error < error[k]))).any()
    ]


def plot(points: list[Point], path: Path, title: str) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(12, 5), constrained_layout=True)
    exact, rest = points[0], points[1:]
    panels = (
        ([p.color_ms / exact.color_ms for p in rest], [min(p.errors.psnr_db, BEST_DB) for p in rest], -1),
        ([p.dominance_ms / exact.dominance_ms for p in rest], [max(p.errors.score_error, 1e-5) for p in rest], 1),
    )
    for axis, (x, y, sign) in zip(axes, panels, strict=True):
        order = sorted(pareto_front(np.array(x), sign * np.array(y)), key=lambda k: x[k])
        axis.scatter(x, y, s=16, color="0.6")
        axis.plot([x[k] for k in order], [y[k] for k in order], "o-", color="tab:blue", markersize=5, linewidth=1)
        height = np.log10(y) if sign > 0 else np.array(y)
        spread = np.column_stack([x / np.ptp(x), height / np.ptp(height)])
        labelled: list[int] = []
        for k in [*order, *(k for k in range(len(x)) if k not in order)]:
            # A label that would lie on another is left out: the table has them all.
            if all(abs(spread[k] - spread[j])[1] > 0.035 or abs(spread[k] - spread[j])[0] > 0.25 for j in labelled):
                labelled.append(k)
                name, tone = rest[k].name, "black" if k in order else "0.5"
                axis.annotate(name, (x[k], y[k]), fontsize=6, color=tone, xytext=(4, 3), textcoords="offset points")
        axis.axvline(1.0, color="0.8", linewidth=0.8, zorder=0)
        axis.set_xlabel("time as a share of the exact frame's")
        axis.margins(x=0.14, y=0.08)
    axes[0].set_ylabel(f"PSNR, dB (cut at {BEST_DB:.0f})")
    axes[1].set_ylabel("mean error of S_vis (at least 1e-5)")
    axes[1].set_yscale("log")
    axes[0].set_title("colour, depth and alpha", fontsize=10)
    axes[1].set_title("dominance only", fontsize=10)
    figure.suptitle(title + "; blue: the Pareto front", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def measure(scene: Gaussians, cameras: list[Camera], rounds: int) -> list[Point]:
    """A point a knob, the exact frames first."""
    stored = scene.sh_degree
    knobs = [k for k in KNOBS if k.quality.sh_degree == EXACT.sh_degree or k.quality.sh_degree < stored]
    clusters = clusters_of(scene)
    truth = Turned(knobs[0], scene, cameras).frames()
    truth["scores"] = scores(truth["dominant"], clusters, len(scene))
    timers = [Turned(knob, scene, cameras) for knob in knobs]
    errors = [compare(timer.frames(), truth, clusters, len(scene)) for timer in timers]
    print("  compared; timing", file=sys.stderr, flush=True)
    least = np.full((len(timers), 2, len(cameras)), np.inf)
    for _ in range(rounds):
        for k, timer in enumerate(timers):
            least[k] = np.minimum(least[k], timer.times())
    middle = np.median(least, axis=2)
    return [Point(knob.name, *map(float, middle[k]), errors[k]) for k, knob in enumerate(knobs)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=("apartment", "showroom"), default="apartment")
    parser.add_argument("--gaussians", type=int, default=200_000, help="size of the apartment")
    parser.add_argument("--views", type=int, default=16)
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
