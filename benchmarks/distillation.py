"""Ground truth on Gaussians: what it labels on a ScanNet scan, what its caps cost, and time and memory by size.

    python -m benchmarks.distillation [SCAN] [--image labels.png]   # audit, then labels and time by cap
    python -m benchmarks.distillation [SCAN] --sizes 100000 500000 2000000
    python -m benchmarks.distillation [SCAN] --memory [--count 2000000]

SCAN is the folder of a scan; scene0000_00 in $SPLATREASONER_DATA (or ../shared/data) by default. Its labels come from
its mesh, so Gaussians that lie on vertices would prove nothing. These are drawn on the surface anew, moved off it,
turned, stretched and of very different sizes; one in a hundred is metres wide. Times are CPU seconds of the process.

--memory takes the peak memory (VmHWM) of a fresh process that loads as many Gaussians and points from files and
distils; it exits with 1 above 1.5 GB.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.apartments import ROOT
from pipeline.construct.distillation.distill import DistillConfig, Distilled, distill
from pipeline.construct.mesh.mesh_ply import Mesh
from pipeline.construct.mesh.mesh_surfels import Surfels, density_surfels
from pipeline.construct.mesh.scannet_labels import ScanNetLabels
from pipeline.construct.mesh.scannet_mesh import build_scannet_mesh, read_scan
from pipeline.scene import Gaussians

DATA = Path(os.environ.get("SPLATREASONER_DATA", ROOT.parent / "shared" / "data"))
LIMIT_GB = 1.5
HUGE = 0.01
"""Share of Gaussians metres wide, as training leaves behind."""
SHOWN_M = 0.04
"""Largest scale of the Gaussians in the picture: wider ones hide what is behind them."""
AUDITED, POINTS = 200_000, 400_000


def area_m2(mesh: Mesh) -> float:
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(cross, axis=1).sum() / 2)


def roughened(surfels: Surfels, rng: np.random.Generator, spread_m: float = 0.01) -> Gaussians:
    """Return surfels moved, turned, stretched and resized at random: nothing of the mesh's vertices is left."""
    base, count = surfels.gaussians, len(surfels.gaussians)
    scales = base.log_scales + rng.normal(0.5, 0.7, (count, 1)) + rng.normal(0.0, 0.4, (count, 3))
    huge = rng.random(count) < HUGE
    scales[huge] = np.log(rng.uniform(0.5, 5.0, (int(huge.sum()), 3)))
    return Gaussians(
        (base.means + rng.normal(0.0, spread_m, (count, 3))).astype(np.float32),
        (base.quats + rng.normal(0.0, 0.15, (count, 4))).astype(np.float32),
        scales.astype(np.float32),
        base.opacity_logits,
        base.sh,
    )


def timed(
    gaussians: Gaussians, points: np.ndarray, labels: np.ndarray, config: DistillConfig
) -> tuple[Distilled, float]:
    start = time.process_time()
    return distill(gaussians, points, labels, config), time.process_time() - start


def share(mask: np.ndarray) -> str:
    return f"{mask.mean():7.2%}"


def audit(scan: Path, image: str | None) -> None:
    """Print what distilling the scan's vertices gives, against the surface each Gaussian was drawn from."""
    from scipy.spatial import cKDTree

    _, mesh, labels, _ = read_scan(scan)
    rng = np.random.default_rng(0)
    surfels = density_surfels(mesh, AUDITED / area_m2(mesh), rng)
    gaussians, origin = roughened(surfels, rng), labels.instance[surfels.vertex]
    small = gaussians.log_scales.max(axis=1) < np.log(0.5)
    found, seconds = timed(gaussians, mesh.vertices, labels.instance, DistillConfig())
    closest = labels.instance[cKDTree(mesh.vertices).query(gaussians.means)[1]]
    print(f"{scan.name}: {len(gaussians):,} Gaussians on {len(mesh.vertices):,} vertices, {seconds:.1f} s")
    print(f"  scales, median and 99 %: {np.exp(np.percentile(gaussians.log_scales, (50, 99))).round(3)} m")
    print(f"  labelled                 {share(found.label >= 0)}  ({share(origin >= 0)} of those drawn are annotated)")
    purity = found.purity[found.label >= 0]
    print(f"  purity                   mean {purity.mean():.3f}, 10 % {np.percentile(purity, 10):.3f}")
    print(
        f"  candidates               median {np.median(found.candidates):.0f}, capped {share(found.candidates == 1000)}"
    )
    middle, most = np.percentile(found.nearest, (50, 99))
    print(f"  nearest point            median {middle:.2f} sigma, 99 % {most:.2f}")
    print(f"  annotated, but unlabelled{share(found.label[(origin >= 0) & small] < 0)}")
    for name, truth in (("nearest vertex", closest), ("surface drawn from", origin)):
        both = (found.label >= 0) & (truth >= 0) & small
        same = found.label == truth
        pure = both & (found.purity > 0.9)
        print(
            f"  agrees with {name:19s}{share(same[both])}; {share(same[pure])} where purity > 0.9 ({share(pure[both])})"
        )
    if image:
        picture(scan, mesh, labels, gaussians, found, image)


def picture(scan: Path, mesh: Mesh, labels: ScanNetLabels, gaussians: Gaussians, found: Distilled, path: str) -> None:
    """Write the scan's own instances, above, and the distilled ones, below, from the same three views."""
    from PIL import Image

    from pipeline.construct.mesh.mesh_surfels import vertex_surfels
    from pipeline.render import category_image, prepare, render

    views = build_scannet_mesh(scan, views=12, width=480, height=360).scene.views[::4]
    colors = np.random.default_rng(3).integers(60, 255, (int(labels.instance.max()) + 2, 3)).astype(np.uint8)
    colors[-1] = 0
    own = vertex_surfels(mesh)
    small = np.flatnonzero(gaussians.log_scales.max(axis=1) < np.log(SHOWN_M))
    rows = []
    for shown, label in ((own.gaussians, labels.instance[own.vertex]), (gaussians.take(small), found.label[small])):
        prepared = prepare(shown)
        images = []
        for view in views:
            dominant = render(prepared, view.camera, ("dominant",)).dominant
            assert dominant is not None
            images.append(colors[category_image(dominant, label)])
        rows.append(np.concatenate(images, axis=1))
    Image.fromarray(np.concatenate(rows)).save(path)
    print(f"  {path}: above the scan's vertices, below the distilled Gaussians; black is unlabelled")


def caps(scan: Path) -> None:
    """Print, for every cap, the labels that differ from the paper's caps and the time."""
    _, mesh, labels, _ = read_scan(scan)
    rng = np.random.default_rng(1)
    density = area_m2(mesh)
    drawn = density_surfels(mesh, AUDITED / 4 / density, rng)
    gaussians, origin = roughened(drawn, rng), labels.instance[drawn.vertex]
    cloud = density_surfels(mesh, POINTS / density, rng)
    points, ids = cloud.gaussians.means, labels.instance[cloud.vertex]
    distill(gaussians.take(slice(0, 100)), points, ids)  # the first call compiles
    paper, _ = timed(gaussians, points, ids, DistillConfig())
    print(f"\ncaps: {len(gaussians):,} Gaussians, {len(points):,} points (as the paper: 5 scales, 1,000 points)")
    print("  scales   most   points   CPU s   labelled   as the paper's   as the surface   median candidates")
    trials = [(5.0, most, 1.0) for most in (10, 50, 100, 250, 500, 1000, 4000, 16000)]
    trials += [(reach, 1000, 1.0) for reach in (1.0, 2.0, 3.0, 4.0)]
    trials += [(5.0, 1000, part) for part in (0.5, 0.25, 0.1, 0.02)] + [(3.0, 250, 1.0), (3.0, 250, 0.25)]
    for reach, most, part in trials:
        kept = np.sort(rng.choice(len(points), round(part * len(points)), replace=False))
        found, seconds = timed(gaussians, points[kept], ids[kept], DistillConfig(reach=reach, most=most))
        known = (found.label >= 0) & (origin >= 0)
        print(
            f"  {reach:6.0f} {most:6,} {part:8.0%} {seconds:7.2f} {share(found.label >= 0):>10s} "
            f"{share(found.label == paper.label):>16s} {share((found.label == origin)[known]):>16s} "
            f"{np.median(found.candidates):19.0f}"
        )


def sizes(scan: Path, counts: list[int]) -> None:
    """Print the time for as many Gaussians as points."""
    _, mesh, labels, _ = read_scan(scan)
    distill(density_surfels(mesh, 1.0, np.random.default_rng(0)).gaussians, mesh.vertices, labels.instance)  # compiles
    print("\n  Gaussians = points   median scale   candidates (mean)   CPU s   us a Gaussian")
    for count in counts:
        rng = np.random.default_rng(2)
        density = count / area_m2(mesh)
        gaussians = roughened(density_surfels(mesh, density, rng), rng)
        gaussians = gaussians.take(rng.permutation(len(gaussians)))
        cloud = density_surfels(mesh, density, rng)
        found, seconds = timed(gaussians, cloud.gaussians.means, labels.instance[cloud.vertex], DistillConfig())
        median = np.exp(np.median(gaussians.log_scales.max(axis=1))) * 1e3
        print(
            f"  {count:18,} {median:11.1f} mm {found.candidates.mean():19.0f} {seconds:7.1f} "
            f"{seconds / count * 1e6:15.1f}"
        )


CHILD = """
import re, resource, sys, numpy as np
from pipeline.construct.distillation.distill import distill
from pipeline.scene import Gaussians
folder, threads = sys.argv[1:]
read = lambda name: np.load(f"{folder}/{name}.npy")
gaussians = Gaussians(*(read(n) for n in ("means", "quats", "log_scales", "opacity_logits", "sh")))
points, labels = read("points"), read("labels")
# Not ru_maxrss: a fresh process inherits that of the one that started it.
peak = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) * 1024
before = peak()
found = distill(gaussians, points, labels, threads=int(threads))
used = resource.getrusage(resource.RUSAGE_SELF)
print(before, peak(), used.ru_utime + used.ru_stime, found.candidates.mean())
"""


def memory(scan: Path, count: int, threads: int) -> bool:
    """Print the peak memory of a fresh process, and return whether it is within the limit."""
    _, mesh, labels, _ = read_scan(scan)
    rng = np.random.default_rng(2)
    density = count / area_m2(mesh)
    with tempfile.TemporaryDirectory() as folder:
        cloud = density_surfels(mesh, density, rng)
        np.save(f"{folder}/points.npy", cloud.gaussians.means)
        np.save(f"{folder}/labels.npy", labels.instance[cloud.vertex])
        del cloud
        gaussians = roughened(density_surfels(mesh, density, rng), rng)
        for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
            np.save(f"{folder}/{name}.npy", getattr(gaussians, name))
        command = [sys.executable, "-c", CHILD, folder, str(threads)]
        out = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    before, peak, seconds, candidates = (float(value) for value in out.split())
    print(
        f"\n  {count:,} Gaussians x {count:,} points, {threads} threads: peak {peak / 1e9:.2f} GB "
        f"({before / 1e9:.2f} GB with the input loaded), {seconds:.0f} CPU s, {candidates:.0f} candidates (mean)"
    )
    return peak <= LIMIT_GB * 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scan", type=Path, nargs="?", default=DATA / "scannet_scene0000_00")
    parser.add_argument("--image", help="PNG of instances, from the scan and distilled.")
    parser.add_argument("--sizes", type=int, nargs="+", help="Only times for these numbers of Gaussians and points.")
    parser.add_argument("--memory", action="store_true", help="Only peak memory.")
    parser.add_argument("--count", type=int, default=2_000_000, help="Gaussians and points for --memory.")
    parser.add_argument("--threads", type=int, default=2, help="Threads for --memory.")
    arguments = parser.parse_args()
    if arguments.memory:
        sys.exit(not memory(arguments.scan, arguments.count, arguments.threads))
    if arguments.sizes:
        sizes(arguments.scan, arguments.sizes)
        return
    audit(arguments.scan, arguments.image)
    caps(arguments.scan)


if __name__ == "__main__":
    main()
