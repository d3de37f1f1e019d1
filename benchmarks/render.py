"""Milliseconds per frame by phase, beside a hand-written AVX2 renderer of the same scenes in the same run.

    python -m benchmarks.render --yardstick FOLDER
    python -m benchmarks.render --scenes showroom --poses 300 --repeats 1 --threads 1   # median and p95 over all poses
    python -m benchmarks.render --compile                                               # what the first frame costs

The yardstick folder holds `floor.py` with `render_floor` and `ns_per_vector`; without it the ratio columns are empty.
The showroom is read from $SPLATREASONER_DATA (or ../shared/data). Every figure is the median over views and repeats;
ours and the yardstick take turns, so that a busy machine slows both. One-thread figures are CPU time, figures of more
threads wall time. The time of compositing is also given per contributing vector (one Gaussian in a block of 4 x 2
pixels, one of which at least takes it) beside the yardstick's blend from registers, which reads nothing.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.geometry import Camera, invert_rigid, look_at, normalise_quats, opengl_to_opencv
from pipeline.render import Rendering, count_blends, prepare, render_many, render_reference
from pipeline.scene.gaussians import Gaussians

ROOT = Path(__file__).resolve().parents[1]
MODES = {"colour": ("color", "depth", "alpha"), "dominance": ("dominant",)}
COUNTED_VIEWS = 12
"""Vectors are counted in this many views or a few more: counting takes longer than drawing."""
PHASES = ("cull", "project", "sort", "bin", "shade", "composite")


def synthetic_room(count: int, seed: int = 0) -> tuple[Gaussians, list[Camera]]:
    """A room of 6 x 5 x 2.8 m with 40 boxes, covered with flat Gaussians of degree 3 and seen from a corner."""
    rng = np.random.default_rng(seed)
    size = np.array([6.0, 5.0, 2.8])
    points = rng.uniform(0, 1, (count, 3)) * size
    on_wall, face = rng.random(count) < 0.6, rng.integers(0, 6, count)
    for side in range(6):
        chosen = on_wall & (face == side)
        points[chosen, side // 2] = (side % 2) * size[side // 2]
    centers, halves = rng.uniform([0.5, 0.5, 0], [5.5, 4.5, 1.5], (40, 3)), rng.uniform(0.1, 0.5, (40, 3))
    box, local, axis = rng.integers(0, 40, count), rng.uniform(-1, 1, (count, 3)), rng.integers(0, 3, count)
    local[np.arange(count), axis] = np.sign(local[np.arange(count), axis])
    points[~on_wall] = (centers[box] + halves[box] * local)[~on_wall]
    log_scales = np.log(rng.lognormal(np.log(0.025 * np.sqrt(1e5 / count)), 0.5, (count, 3)))
    log_scales[np.arange(count), rng.integers(0, 3, count)] -= 2.0
    sh = rng.normal(0, 0.3, (count, 16, 3)) * np.r_[1.0, np.full(15, 0.3)][:, None]
    scene = Gaussians(
        points.astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        log_scales.astype(np.float32),
        rng.normal(1.0, 2.0, count).astype(np.float32),
        sh.astype(np.float32),
    )
    K = np.array([[577.0, 0, 320], [0, 577, 240], [0, 0, 1]])
    eye, target = np.array([0.6, 0.6, 1.6]), np.array([4.0, 3.5, 0.9])
    return scene, [Camera(K, look_at(eye, target, np.array([0.0, 0, 1])), 640, 480)]


def showroom_folder() -> Path:
    return Path(os.environ.get("SPLATREASONER_DATA", ROOT.parent / "shared" / "data")) / "showroom"


def showroom(poses: int) -> tuple[Gaussians, list[Camera]]:
    """The real apartment and `poses` of its recorded views, evenly spaced."""
    folder = showroom_folder()
    if not folder.is_dir():
        sys.exit(f"no showroom at {folder}: set SPLATREASONER_DATA or choose other --scenes")
    raw = (folder / "showroom_lod3.ply").read_bytes()
    body = raw.index(b"end_header\n") + len(b"end_header\n")
    rows = np.frombuffer(raw[body:], "<f4").reshape(-1, 14)
    xyz, scales, dc, opacity, quats = np.split(rows, [3, 6, 9, 10], axis=1)
    scene = Gaussians(xyz.copy(), quats.copy(), scales.copy(), opacity[:, 0].copy(), dc[:, None, :].copy())
    capture = json.loads((folder / "transforms.json").read_text())
    K = np.array([[capture["fl_x"], 0, capture["cx"]], [0, capture["fl_y"], capture["cy"]], [0, 0, 1.0]])
    frames = capture["frames"]
    chosen = [frames[k * len(frames) // poses] for k in range(min(poses, len(frames)))]
    poses_in = [invert_rigid(opengl_to_opencv(np.array(frame["transform_matrix"]))) for frame in chosen]
    return scene, [Camera(K, pose, capture["w"], capture["h"]) for pose in poses_in]


def yardstick_frame(module, scene: Gaussians) -> Callable[[Camera, int], dict]:
    """A function that draws a view with the yardstick; its activated copies of the scene are made once."""
    sh = np.zeros((len(scene), 16, 3), np.float32)
    sh[:, : scene.sh.shape[1]] = scene.sh
    opacities = 1 / (1 + np.exp(-scene.opacity_logits.astype(np.float64)))
    arrays = [scene.means, normalise_quats(scene.quats), np.exp(scene.log_scales), opacities, sh]
    arrays = [np.ascontiguousarray(array, np.float32) for array in arrays]

    def draw(camera: Camera, threads: int) -> dict:
        return module.render_floor(
            *arrays, camera.world_to_camera, camera.K, camera.width, camera.height, threads=threads
        )

    return draw


def our_frame(prepared, camera: Camera, outputs: tuple[str, ...], threads: int) -> tuple[Rendering, dict, dict]:
    """One frame of ours, its milliseconds by phase and its counts."""
    from pipeline.render.passes import FrameStatistics, render_frame

    statistics = FrameStatistics()
    clock = time.thread_time if threads == 1 else time.perf_counter
    start = clock()
    rendering = render_frame(
        prepared, camera, frozenset(outputs), background=(0, 0, 0), near=0.2, sh_degree=prepared.sh_degree,
        antialias=False, threads=threads, statistics=statistics,
    )  # fmt: skip
    return rendering, {**statistics.milliseconds, "total": 1e3 * (clock() - start)}, statistics.counts


def yardstick_total(draw: Callable[[Camera, int], dict], camera: Camera, threads: int) -> tuple[dict, float]:
    """One frame of the yardstick and its milliseconds, by the same clock as ours."""
    clock = time.thread_time if threads == 1 else time.perf_counter
    start = clock()
    frame = draw(camera, threads)
    return frame, 1e3 * (clock() - start)


def psnr_db(a: np.ndarray, b: np.ndarray) -> float:
    return float(-10 * np.log10(max(float(np.mean((a.astype(np.float64) - b) ** 2)), 1e-30)))


def measure(name: str, scene: Gaussians, cameras: list[Camera], repeats: int, threads: list[int], module) -> None:
    start = time.perf_counter()
    prepared = prepare(scene)
    print(f"\n{name}: {len(scene)} Gaussians, {len(cameras)} views, prepared in {time.perf_counter() - start:.2f} s")
    print(f"{'mode':10} threads  " + " ".join(f"{p:>9}" for p in PHASES) + "     total      p95  yardstick  ratio"
          "   vs yardstick: PSNR  dominant")  # fmt: skip
    draw = yardstick_frame(module, scene) if module else None
    for number in threads:
        ours: dict[str, list[dict]] = {mode: [] for mode in MODES}
        theirs: list[float] = []
        agreement: dict[str, list[float]] = {mode: [] for mode in MODES}
        for camera in cameras:
            for outputs in MODES.values():
                our_frame(prepared, camera, outputs, number)
            for _ in range(repeats):
                frame = None
                if draw:
                    frame, milliseconds = yardstick_total(draw, camera, number)
                    theirs.append(milliseconds)
                for mode, outputs in MODES.items():
                    rendering, spent, _ = our_frame(prepared, camera, outputs, number)
                    ours[mode].append(spent)
                    if frame is not None and mode == "colour":
                        agreement[mode].append(psnr_db(rendering.color, frame["color"]))
                    elif frame is not None:
                        agreement[mode].append(float(np.mean(rendering.dominant == frame["dominant"])))
        for mode, rows in ours.items():
            phases = " ".join(f"{np.median([row.get(p, 0.0) for row in rows]):9.2f}" for p in PHASES)
            totals = np.array([row["total"] for row in rows])
            line = f"{mode:10} {number:7}  {phases} {np.median(totals):9.2f} {np.quantile(totals, 0.95):8.2f}"
            if theirs:
                line += f"  {np.median(theirs):9.2f} {np.median(totals) / np.median(theirs):6.2f}"
                worst = min(agreement[mode])
                line += f"   {worst:18.1f} dB" if mode == "colour" else f"   {'':20} {100 * worst:8.4f} %"
            print(line, flush=True)
            if number == 1:
                print(vector_line(mode, prepared, cameras, rows, repeats, module), flush=True)
    if len(cameras) > 1:
        many_views(prepared, cameras, 2)


def vector_line(mode: str, prepared, cameras: list[Camera], rows: list[dict], repeats: int, module) -> str:
    """Nanoseconds of compositing per contributing vector: the median over some views, each by its least repeat."""
    some = slice(None, None, max(1, len(cameras) // COUNTED_VIEWS))
    composite = np.array([row["composite"] for row in rows]).reshape(len(cameras), repeats).min(axis=1)[some]
    cameras = cameras[some]
    counts = [count_blends(prepared, camera, dominance=mode == "dominance") for camera in cameras]
    each = composite * 1e6 / np.maximum([count.contributing for count in counts], 1)
    contributing, evaluated = (sum(getattr(c, name) for c in counts) for name in ("contributing", "vectors"))
    line = f"{'':10} composite: {np.median(each):.2f} ns per contributing vector "
    line += (
        f"({contributing / len(cameras) / 1e6:.2f}M a view, {100 * contributing / evaluated:.0f} % of those evaluated)"
    )
    return line + (f"; from registers {module.ns_per_vector():.2f} ns" if module else "")


def processor() -> str:
    """The processor's name where the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    return next((line.split(": ")[1] for line in lines if line.startswith("model name")), platform.machine())


def error_against_reference(module) -> None:
    """Ours and the yardstick against float64, on a view small enough for NumPy."""
    scene, (camera,) = synthetic_room(20_000)
    camera = camera.resized(160, 120)
    truth = render_reference(scene, camera)
    found = our_frame(prepare(scene), camera, ("color", "depth", "alpha", "dominant"), 1)[0]
    depth = np.abs(found.depth - truth.depth) / np.maximum(truth.depth, 1e-6)
    print(f"\nagainst float64 (20,000 Gaussians, 160 x 120): ours PSNR {psnr_db(found.color, truth.color):.1f} dB, "
          f"dominant equal on {100 * np.mean(found.dominant == truth.dominant):.4f} %, "
          f"depth within 1e-4 on {100 * np.mean(depth <= 1e-4):.3f} %")  # fmt: skip
    if module:
        frame = yardstick_frame(module, scene)(camera, 1)
        print(f"  yardstick PSNR {psnr_db(frame['color'], truth.color):.1f} dB, "
              f"dominant equal on {100 * np.mean(frame['dominant'] == truth.dominant):.4f} %")  # fmt: skip


def compile_time() -> None:
    """CPU seconds from the start of a process to its first frame: with an empty cache, then with the one it left."""
    code = (
        "import time; from benchmarks.render import *; s, (c,) = synthetic_room(1000); p = prepare(s)\n"
        "before = time.process_time(); our_frame(p, c, MODES[sys.argv[1]], 1); now = time.process_time()\n"
        "print(f'{now:9.2f} {now - before:20.2f}')"
    )
    print(f"\nCPU seconds {'':18} to the first frame  the frame alone")
    for mode in MODES:
        with tempfile.TemporaryDirectory() as cache:
            for label in ("empty cache", "cached"):
                environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": str(ROOT)}
                command = [sys.executable, "-c", code, mode]
                found = subprocess.run(command, env=environment, cwd=ROOT, check=True, capture_output=True, text=True)
                print(f"{mode:10} {label:18} {found.stdout.rstrip()}", flush=True)


def many_views(prepared, cameras: list[Camera], threads: int) -> None:
    """Wall seconds of all dominance maps, one core per view."""
    start = time.perf_counter()
    for _ in render_many(prepared, cameras, MODES["dominance"], threads=threads):
        pass
    spent = time.perf_counter() - start
    print(f"{'':10} render_many on {threads} threads: {len(cameras)} dominance maps in {spent:.2f} s of wall time")


def print_machine() -> None:
    """One line: processor and versions."""
    import llvmlite
    import numba

    print(
        f"{processor()}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}, "
        f"numpy {np.__version__}, numba {numba.__version__}, llvmlite {llvmlite.__version__}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--yardstick", type=Path, help="folder with floor.py")
    parser.add_argument("--scenes", nargs="+", default=["100k", "500k", "showroom"])
    parser.add_argument("--poses", type=int, default=6, help="views of the showroom")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--compile", action="store_true", help="only measure compile time")
    options = parser.parse_args()
    print_machine()
    if options.compile:
        compile_time()
        return
    module = None
    if options.yardstick:
        sys.dont_write_bytecode = True
        sys.path.insert(0, str(options.yardstick.resolve()))
        module = importlib.import_module("floor")
    for name in options.scenes:
        count = {"100k": 100_000, "500k": 500_000}.get(name)
        scene, cameras = showroom(options.poses) if count is None else synthetic_room(count)
        measure(name, scene, cameras, options.repeats, options.threads, module)
    error_against_reference(module)


if __name__ == "__main__":
    main()
