"""What each way to render faster costs in error: one line a knob, and the Pareto plot of them all.

    python -m benchmarks.error_vs_time                      # a generated apartment
    python -m benchmarks.error_vs_time --scene showroom     # real data, where it lies
    python -m benchmarks.error_vs_time --plot docs/images/error_vs_time.png

Truth is our own exact frame (the default), which `benchmarks/render.py` holds to float64 (more than 100 dB, where every
knob costs far more). Times are CPU milliseconds on one thread, the least over the repeats of a view, then the median
over views; ratios are to exact frames timed right before, as a shared machine is not equally fast for long. Cut-offs
are constants of the kernels; each is tried in a process of its own that replaces them before the first compile, with a
compile cache of its own. The tile size is not a knob here: the block masks are built on 16 x 16.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.render import ROOT, psnr_db, showroom
from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, prepare, render
from pipeline.scene.gaussians import Gaussians

CLUSTERS, CLUSTER_RADIUS_M = 300, 0.4
COLOR, DOMINANCE = ("color", "depth", "alpha"), ("dominant",)


@dataclass(frozen=True, slots=True)
class Knob:
    """One way to trade error for time."""

    name: str
    shrink: float = 1.0
    """Image sides are divided by this, and the image is enlarged again (colour linearly, indices by nearest)."""
    sh_degree: int | None = None
    """Highest degree of colour used; None for all."""
    prune: float = 0.0
    """Gaussians of lower opacity are left out."""
    half: tuple[str, ...] = ()
    """Attributes rounded to float16."""
    constants: dict[str, float] = field(default_factory=dict)
    """Cut-offs: alpha_min, t_min, exp_degree."""


KNOBS = (
    Knob("exact"),
    Knob("resolution 1/1.5", shrink=1.5),
    Knob("resolution 1/2", shrink=2),
    Knob("resolution 1/3", shrink=3),
    Knob("resolution 1/4", shrink=4),
    Knob("SH degree 2", sh_degree=2),
    Knob("SH degree 1", sh_degree=1),
    Knob("SH degree 0", sh_degree=0),
    Knob("opacity >= 0.02", prune=0.02),
    Knob("opacity >= 0.05", prune=0.05),
    Knob("opacity >= 0.1", prune=0.1),
    Knob("opacity >= 0.2", prune=0.2),
    Knob("float16 scale, turn, opacity", half=("quats", "log_scales", "opacity_logits")),
    Knob("float16 colour", half=("sh",)),
    Knob("float16 means", half=("means",)),
    Knob("alpha >= 2/255", constants={"alpha_min": 2 / 255}),
    Knob("alpha >= 4/255", constants={"alpha_min": 4 / 255}),
    Knob("alpha >= 8/255", constants={"alpha_min": 8 / 255}),
    Knob("stop at T < 1e-3", constants={"t_min": 1e-3}),
    Knob("stop at T < 1e-2", constants={"t_min": 1e-2}),
    Knob("exp of degree 4", constants={"exp_degree": 4}),
    Knob("exp of degree 3", constants={"exp_degree": 3}),
    Knob("alpha 2/255, T 1e-3", constants={"alpha_min": 2 / 255, "t_min": 1e-3}),
    Knob("alpha 4/255, T 1e-3", constants={"alpha_min": 4 / 255, "t_min": 1e-3}),
    Knob("alpha 4/255, T 1e-3, 1/2", shrink=2, constants={"alpha_min": 4 / 255, "t_min": 1e-3}),
)


@dataclass(frozen=True, slots=True)
class Point:
    """What one knob measured, over all views."""

    name: str
    color_ms: float
    dominance_ms: float
    color_ratio: float
    """Time as a share of the exact frames' that were timed right before."""
    dominance_ratio: float
    psnr_db: float
    ssim: float
    same_dominant: float
    score_error: float
    """Mean |S_vis - exact S_vis| over clusters and views that see them."""
    same_best_view: float
    """Share of clusters whose best view stays the same."""
    regret: float
    """Mean relative loss of S_vis by taking the best view this knob names."""


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


def enlarged(image: np.ndarray, camera: Camera, order: int) -> np.ndarray:
    """The image on the grid of `camera`: order 1 linear, 0 nearest."""
    from scipy.ndimage import map_coordinates

    height, width = image.shape[:2]
    if (width, height) == (camera.width, camera.height):
        return image
    rows = (np.arange(camera.height) + 0.5) * height / camera.height - 0.5
    columns = (np.arange(camera.width) + 0.5) * width / camera.width - 0.5
    grid = np.meshgrid(rows, columns, indexing="ij")
    if image.ndim == 2:
        return map_coordinates(image, grid, order=order, mode="nearest")
    return np.stack([map_coordinates(image[..., k], grid, order=order, mode="nearest") for k in range(3)], axis=-1)


def turned(knob: Knob, scene: Gaussians) -> tuple[PreparedGaussians, np.ndarray]:
    """The scene with the knob turned, prepared, and the index in the scene of each Gaussian left."""
    arrays = {name: getattr(scene, name) for name in ("means", "quats", "log_scales", "opacity_logits", "sh")}
    for name in knob.half:
        arrays[name] = arrays[name].astype(np.float16).astype(np.float32)
    changed = Gaussians(**arrays)
    kept = np.flatnonzero(changed.opacity_logits >= np.log(knob.prune / (1 - knob.prune))) if knob.prune else None
    if kept is None:
        return prepare(changed), np.arange(len(scene))
    return prepare(changed.take(kept)), kept


def timed(prepared: PreparedGaussians, camera: Camera, outputs: tuple[str, ...], degree: int | None, repeats: int):
    best = np.inf
    for _ in range(repeats + 1):  # the first one compiles, and touches memory
        start = time.thread_time()
        rendering = render(prepared, camera, outputs, sh_degree=degree)
        best = min(best, time.thread_time() - start)
    return rendering, 1e3 * best


def frames(knob: Knob, scene: Gaussians, cameras: list[Camera], repeats: int) -> dict[str, np.ndarray]:
    """Colour and dominance of every view on the full grid, and milliseconds."""
    prepared, kept = turned(knob, scene)
    back = np.append(kept, -1).astype(np.int32)
    found: dict[str, list] = {"color": [], "dominant": [], "color_ms": [], "dominance_ms": []}
    for camera in cameras:
        size = round(camera.width / knob.shrink), round(camera.height / knob.shrink)
        small = camera.resized(*size) if knob.shrink != 1 else camera
        image, milliseconds = timed(prepared, small, COLOR, knob.sh_degree, repeats)
        found["color"].append(enlarged(image.color, camera, 1))
        found["color_ms"].append(milliseconds)
        image, milliseconds = timed(prepared, small, DOMINANCE, knob.sh_degree, repeats)
        found["dominant"].append(back[enlarged(image.dominant, camera, 0)])
        found["dominance_ms"].append(milliseconds)
    return {name: np.array(values) for name, values in found.items()}


def compare(
    knob: Knob, found: dict, truth: dict, clusters: list[np.ndarray], count: int, exact_ms: tuple[float, float]
) -> Point:
    exact, ours = truth["scores"], scores(found["dominant"], clusters, count)
    seen = exact.max(axis=1) > 0
    rows = np.flatnonzero(seen)
    chosen, best = ours[rows].argmax(axis=1), exact[rows].argmax(axis=1)
    top = exact[rows, best]
    return Point(
        name=knob.name,
        color_ms=float(np.median(found["color_ms"])),
        dominance_ms=float(np.median(found["dominance_ms"])),
        color_ratio=float(np.median(found["color_ms"])) / exact_ms[0],
        dominance_ratio=float(np.median(found["dominance_ms"])) / exact_ms[1],
        psnr_db=float(np.mean([psnr_db(np.clip(a, 0, 1), np.clip(b, 0, 1))
                               for a, b in zip(found["color"], truth["color"], strict=True)])),
        ssim=float(np.mean([ssim(a, b) for a, b in zip(found["color"], truth["color"], strict=True)])),
        same_dominant=float(np.mean(found["dominant"] == truth["dominant"])),
        score_error=float(np.abs(ours - exact)[exact > 0].mean()),
        same_best_view=float(np.mean(exact[rows, chosen] == top)),
        regret=float(np.mean((top - exact[rows, chosen]) / top)),
    )  # fmt: skip


def replace_constants(alpha_min: float = 1 / 255, t_min: float = 1e-4, exp_degree: int = 5) -> None:
    """Replace the kernels' cut-offs: to be called before anything was rendered in this process."""
    from pipeline.render import project_kernels, tile_kernels

    project_kernels.LOG2_255 = np.float32(-np.log2(alpha_min))
    tile_kernels.LOG2_ALPHA_MIN = np.float32(np.log2(alpha_min))
    tile_kernels.T_MIN = np.float32(t_min)
    if exp_degree < 5:
        x = -4 + 4 * np.cos(np.pi * (np.arange(400) + 0.5) / 400)
        fit = np.polynomial.Polynomial.fit(x, 2 ** (x / 8), exp_degree, w=2 ** (-x / 8)).convert().coef
        for k in range(6):
            setattr(tile_kernels, f"E{k}", np.float32(fit[k] if k <= exp_degree else 0.0))


def table(points: list[Point]) -> str:
    lines = [f"{'knob':30} {'colour ms':>9} {'ratio':>6} {'dominance':>9} {'ratio':>6} {'PSNR dB':>8} {'SSIM':>7} "
             f"{'same id':>9} {'|dS|':>7} {'best view':>9} {'regret':>7}"]  # fmt: skip
    for p in points:
        lines.append(f"{p.name:30} {p.color_ms:9.2f} {p.color_ratio:6.2f} {p.dominance_ms:9.2f} "
                     f"{p.dominance_ratio:6.2f} {min(p.psnr_db, 999):8.1f} {p.ssim:7.4f} "
                     f"{100 * p.same_dominant:7.2f} % {p.score_error:7.4f} {100 * p.same_best_view:7.1f} % "
                     f"{100 * p.regret:5.2f} %")  # fmt: skip
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

    figure, axes = plt.subplots(1, 2, figsize=(11, 4.6), constrained_layout=True)
    rest = points[1:]  # all but the exact frame, whose error is 0
    panels = (
        (axes[0], [p.color_ratio for p in rest], [p.psnr_db for p in rest], True, "PSNR, dB"),
        (axes[1], [p.dominance_ratio for p in rest], [100 * p.regret for p in rest], False,
         "loss of S_vis in the best view, %"),
    )  # fmt: skip
    for axis, x, y, more_is_better, label in panels:
        front = pareto_front(np.array(x), np.array(y) * (-1 if more_is_better else 1))
        axis.scatter(x, y, s=18, color="0.6")
        order = sorted(front, key=lambda k: x[k])
        axis.plot([x[k] for k in order], [y[k] for k in order], "o-", color="tab:blue", markersize=5, linewidth=1)
        for k in order:
            axis.annotate(rest[k].name, (x[k], y[k]), fontsize=7, xytext=(4, 4), textcoords="offset points")
        axis.axvline(1.0, color="0.8", linewidth=0.8, zorder=0)
        axis.set_xlabel("time as a share of the exact frame's")
        axis.set_ylabel(label)
        axis.margins(x=0.15, y=0.08)
    axes[0].set_title("colour, depth and alpha", fontsize=10)
    axes[1].set_title("dominance only", fontsize=10)
    figure.suptitle(title, fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def exact_times(prepared: PreparedGaussians, cameras: list[Camera], repeats: int) -> tuple[float, float]:
    """Median milliseconds of exact frames: colour, dominance."""
    times = [
        [timed(prepared, camera, outputs, None, repeats)[1] for camera in cameras] for outputs in (COLOR, DOMINANCE)
    ]
    return float(np.median(times[0])), float(np.median(times[1]))


def in_child(knob: Knob, arguments: list[str], folder: Path, exact_ms: tuple[float, float]) -> Point:
    """The point of a knob that needs its own kernels."""
    name = "-".join(f"{key}-{value:.6g}" for key, value in sorted(knob.constants.items()))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / name), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "benchmarks.error_vs_time", *arguments, "--child", json.dumps(asdict(knob))]
    command += ["--exact-ms", *map(str, exact_ms)]
    ran = subprocess.run(
        [*command, "--folder", str(folder)], env=environment, cwd=ROOT, check=True, capture_output=True
    )
    return Point(**json.loads(ran.stdout))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=("apartment", "showroom"), default="apartment")
    parser.add_argument("--gaussians", type=int, default=200_000, help="size of the apartment")
    parser.add_argument("--views", type=int, default=16)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--plot", type=Path, help="PNG of the Pareto plot")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--exact-ms", type=float, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()

    if options.scene == "apartment":
        scene, cameras = apartment(options.views, options.gaussians)
    else:
        scene, cameras = showroom(options.views)
    clusters = clusters_of(scene)
    if options.child:
        knob = Knob(**json.loads(options.child))
        replace_constants(**knob.constants)
        truth = dict(np.load(options.folder / "truth.npz"))
        found = frames(knob, scene, cameras, options.repeats)
        print(json.dumps(asdict(compare(knob, found, truth, clusters, len(scene), options.exact_ms))))
        return
    title = (
        f"{options.scene}, {len(scene):,} Gaussians, {len(cameras)} views of {cameras[0].width} x {cameras[0].height}"
    )
    print(title, flush=True)
    arguments = ["--scene", options.scene, "--gaussians", str(options.gaussians), "--views", str(options.views),
                 "--repeats", str(options.repeats)]  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth = frames(KNOBS[0], scene, cameras, options.repeats)
        truth["scores"] = scores(truth["dominant"], clusters, len(scene))
        np.savez(folder / "truth.npz", **truth)
        exact, points = prepare(scene), []
        for knob in KNOBS:
            if knob.sh_degree is not None and (knob.sh_degree + 1) ** 2 >= scene.sh.shape[1]:
                continue
            exact_ms = exact_times(exact, cameras, options.repeats)
            if knob.constants:
                points.append(in_child(knob, arguments, folder, exact_ms))
            else:
                found = frames(knob, scene, cameras, options.repeats)
                points.append(compare(knob, found, truth, clusters, len(scene), exact_ms))
            print("  measured", knob.name, file=sys.stderr, flush=True)
    print(table(points))
    if options.plot:
        plot(points, options.plot, title)


if __name__ == "__main__":
    main()
