"""Visibility in every recorded view of a scene: seconds, bytes, scores of clusters and pictures of the best views.

    python benchmarks/visibility.py SCENE [--clusters 300] [--sheet best_views.png]

A scene without categories can be scored too: each cluster is the set of Gaussians within a radius of one that is
drawn at random, so that the figures depend on nothing but geometry.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.render import category_image, color_image, prepare, render
from pipeline.scene import Scene
from pipeline.scene.load import load_scene


def balls(scene: Scene, count: int, radius_m: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Return sorted indices of the Gaussians within a radius of `count` random ones that are not transparent."""
    from scipy.spatial import cKDTree

    means = scene.gaussians.means
    tree = cKDTree(means)
    centres = rng.choice(np.flatnonzero(scene.gaussians.opacity_logits > 0), count, replace=False)
    return [np.sort(np.array(ids, np.int32)) for ids in tree.query_ball_point(means[centres], radius_m)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="scene folder or URI")
    parser.add_argument("--clusters", type=int, default=300)
    parser.add_argument("--radius", type=float, default=0.4, help="radius of a cluster, metres")
    parser.add_argument("--sheet", help="PNG with the best view of 12 clusters, the cluster in red")
    args = parser.parse_args()

    start = time.perf_counter()
    scene = load_scene(args.scene)
    print(f"load          {time.perf_counter() - start:8.2f} s   {len(scene.gaussians):,} Gaussians")
    start = time.perf_counter()
    prepared = prepare(scene.gaussians)
    print(f"prepare       {time.perf_counter() - start:8.2f} s")
    index = VisibilityIndex(prepared, [view.camera for view in scene.views], VisibilityConfig())
    index.ids(0)  # the first call compiles
    seconds = []
    for view in range(len(index)):
        start = time.perf_counter()
        index.ids(view)
        seconds.append(time.perf_counter() - start)
    milliseconds = np.array(seconds[1:]) * 1e3
    sizes = np.array([len(index.ids(view)) for view in range(len(index))])
    print(f"dominance     {sum(seconds):8.2f} s   {len(index)} views, one thread")
    print(f"  a view      {np.median(milliseconds):8.1f} ms median, {np.percentile(milliseconds, 95):.1f} ms p95")
    print(f"  ids a view  {int(np.median(sizes)):8,}     {index.nbytes / len(index) / 1e3:.1f} kB")
    clusters = balls(scene, args.clusters, args.radius, np.random.default_rng(0))
    start = time.perf_counter()
    scores = index.counts(clusters).scores
    print(f"first scores  {(time.perf_counter() - start) * 1e3:8.1f} ms  {len(clusters)} clusters, D transposed once")
    start = time.perf_counter()
    scores = index.counts(clusters).scores
    print(f"scores        {(time.perf_counter() - start) * 1e3:8.1f} ms  in all views")
    best = scores.max(axis=1)
    print(f"best S_vis    {np.median(best):8.3f}     median; {int((best == 0).sum())} clusters that no view sees")
    if args.sheet:
        _sheet(args.sheet, scene, prepared, clusters, scores)


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
    print(f"sheet         {path}")


if __name__ == "__main__":
    main()
