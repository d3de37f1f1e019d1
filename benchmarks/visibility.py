"""The visibility index of a scene: seconds and bytes a view, disk, the join that scores read, scores of clusters.

    python -m benchmarks.visibility [SCENE ...] [--views 300] [--sheet best_views.png]
    python -m benchmarks.visibility --memory [--gaussians 2000000] [--views 1000]

Without a scene: the showroom in $SPLATREASONER_DATA (or ../shared/data) and a generated apartment of 500,000 Gaussians
and 300 views. A scene without categories can be scored too: each cluster is the set of Gaussians within a radius of
one that is drawn at random, so that the figures depend on nothing but geometry.

--memory takes the peak memory (VmHWM) of a fresh process that loads an apartment, renders and stores every view,
reads the store back, joins it and scores clusters; it exits with 1 above 2 GB.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.apartments import ROOT, apartment
from jobs.scenes.index import build_index
from pipeline.query.transposed import Transposed
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.query.visibility_store import VisibilityStore
from pipeline.render import category_image, color_image, prepare, render
from pipeline.scene import Scene
from pipeline.scene.load import load_scene

DATA = Path(os.environ.get("SPLATREASONER_DATA", ROOT.parent / "shared" / "data"))
LIMIT_GB = 2.0
CONFIG = VisibilityConfig()


def balls(scene: Scene, count: int, radius_m: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Return sorted indices of the Gaussians within a radius of `count` random ones that are not transparent."""
    from scipy.spatial import cKDTree

    means = scene.gaussians.means
    tree = cKDTree(means)
    centres = rng.choice(np.flatnonzero(scene.gaussians.opacity_logits > 0), count, replace=False)
    return [np.sort(np.array(ids, np.int32)) for ids in tree.query_ball_point(means[centres], radius_m)]


def measure(uri: str, most_views: int, clusters: int, radius_m: float, sheet: str | None) -> None:
    start = time.perf_counter()
    scene = load_scene(uri)
    views = scene.views[:most_views]
    cameras = [view.camera for view in views]
    print(f"\n{scene.name}: {len(scene.gaussians):,} Gaussians, {len(views)} views")
    row("load the scene", time.perf_counter() - start)
    start = time.perf_counter()
    gaussians = prepare(scene.gaussians)
    row("prepare it", time.perf_counter() - start)

    VisibilityIndex(gaussians, cameras[:1], CONFIG).build()  # the first call compiles
    for threads in (1, 2):
        index = VisibilityIndex(gaussians, cameras, CONFIG)
        wall, cpu = time.perf_counter(), time.process_time()
        index.build(threads)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        each = f"{wall / len(index) * 1e3:.1f} ms a view, {cpu / len(index) * 1e3:.1f} ms of CPU"
        row(f"render, {threads} core{'s' * (threads > 1)}", wall, each)
    rows = {view: index.ids(view) for view in range(len(index))}
    sizes = np.array([len(ids) for ids in rows.values()])
    print(f"  ids a view        {int(np.median(sizes)):9,}     median, {sizes.mean() * 4 / 1e3:.1f} kB mean")

    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        store = VisibilityStore.of(folder, scene.gaussians, cameras, CONFIG)
        row("hash scene", time.perf_counter() - start)
        start = time.perf_counter()
        for first in range(0, len(rows), 32):
            store.write({view: rows[view] for view in range(first, min(first + 32, len(rows)))})
        size = sum(path.stat().st_size for path in Path(folder).rglob("*.arrow"))
        row("store rows", time.perf_counter() - start, f"{size / len(rows) / 1e3:.1f} kB a view on disk")
        start = time.perf_counter()
        found = store.read()
        row("read rows", time.perf_counter() - start, "mapped, every byte hashed")

    Transposed.of([found.ids[0]], len(gaussians)).counts([found.ids[0]])  # compiles
    start = time.perf_counter()
    joined = Transposed.of([found.ids[view] for view in range(len(rows))], len(gaussians))
    row("join", time.perf_counter() - start, f"{joined.nbytes / 1e6:.1f} MB, once a node")
    chosen = balls(scene, clusters, radius_m, np.random.default_rng(0))
    index.adopt_transposed(joined)
    start = time.perf_counter()
    scores = index.counts(chosen).scores
    row("scores", time.perf_counter() - start, f"{len(chosen)} clusters of {np.mean([len(c) for c in chosen]):.0f}")
    best = scores.max(axis=1)
    print(f"  best S_vis        {np.median(best):9.3f}     median; {int((best == 0).sum())} clusters that no view sees")
    if sheet:
        _sheet(sheet, scene, gaussians, chosen, scores)


def row(name: str, seconds: float, note: str = "") -> None:
    shown = f"{seconds:9.2f} s " if seconds >= 1 else f"{seconds * 1e3:9.1f} ms"
    print(f"  {name:17} {shown}   {note}")


def peak_memory(folder: str, clusters: int) -> None:
    """Print the peak of this process after each step of using a scene's index."""
    shown = memory("imports")
    with tempfile.TemporaryDirectory() as store:
        built = build_index(folder, store, CONFIG, threads=2)
        shown = memory(f"{built.rendered} views rendered, {built.nbytes / 1e6:.0f} MB stored")
        scene = load_scene(folder)
        cameras = [view.camera for view in scene.views]
        found = VisibilityStore.of(store, scene.gaussians, cameras, CONFIG).read()
        shown = memory(f"{len(found.ids)} views read back")
        index = VisibilityIndex(prepare(scene.gaussians), cameras, CONFIG)
        for view, ids in found.ids.items():
            index.adopt(view, ids)
        index.counts([np.arange(10, dtype=np.int32)])
        shown = memory("joined")
        index.counts(balls(scene, clusters, 0.4, np.random.default_rng(0)))
        shown = memory(f"{clusters} clusters scored")
    sys.exit(shown > LIMIT_GB)


def memory(step: str) -> float:
    """Print and return the peak resident memory of this process so far, GB."""
    status = Path("/proc/self/status").read_text()
    peak, now = (int(re.search(rf"{name}:\s+(\d+)", status)[1]) / 1e6 for name in ("VmHWM", "VmRSS"))
    print(f"  peak {peak:5.2f} GB, now {now:5.2f} GB   {step}", flush=True)
    return peak


def _sheet(path: str, scene: Scene, prepared: object, clusters: list[np.ndarray], scores: np.ndarray) -> None:
    from PIL import Image

    panels = []
    for number in np.argsort(-scores.max(axis=1))[:: max(1, len(clusters) // 12)][:12]:
        camera = scene.views[int(scores[number].argmax())].camera
        image = render(prepared, camera, outputs=("color", "dominant"))
        member = np.zeros(len(scene.gaussians), np.int32)
        member[clusters[number]] = 1
        picture = color_image(image).astype(np.float64)
        picture[category_image(image.dominant, member) == 1] *= (0.5, 0.5, 0.5)
        picture[category_image(image.dominant, member) == 1] += (127, 0, 0)
        panels.append(np.asarray(Image.fromarray(picture.astype(np.uint8)).resize((400, 300))))
    rows = [np.concatenate(panels[start : start + 4], axis=1) for start in range(0, len(panels), 4)]
    Image.fromarray(np.concatenate(rows)).save(path)
    print(f"  sheet             {path}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="scene folders or URIs")
    parser.add_argument("--views", type=int, help="most views: 300, or 1,000 with --memory")
    parser.add_argument("--clusters", type=int, default=300)
    parser.add_argument("--radius", type=float, default=0.4, help="radius of a cluster, metres")
    parser.add_argument("--sheet", help="PNG with the best view of 12 clusters of the last scene, the cluster in red")
    parser.add_argument("--memory", action="store_true", help="peak memory of a large apartment")
    parser.add_argument("--gaussians", type=int, default=2_000_000, help="of that apartment")
    parser.add_argument("--peak-of", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.peak_of:
        peak_memory(args.peak_of, args.clusters)
    if args.memory:
        large = apartment(gaussians=args.gaussians, views=args.views or 1000)
        print(f"{large.name}: at most {LIMIT_GB:g} GB")
        command = [sys.executable, "-m", "benchmarks.visibility", "--peak-of", str(large)]
        sys.exit(subprocess.run(command, cwd=ROOT, check=False).returncode)
    views = args.views or 300
    if not args.scenes:
        showroom = DATA / "showroom"
        found = [str(showroom)] if showroom.is_dir() else []
        args.scenes = [*found, str(apartment(gaussians=500_000, views=300))]
    for number, uri in enumerate(args.scenes, start=1):
        measure(uri, views, args.clusters, args.radius, args.sheet if number == len(args.scenes) else None)


if __name__ == "__main__":
    main()
