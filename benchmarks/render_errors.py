"""What a faster frame gets wrong: the image, the dominant Gaussians, and the visibility scores made from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.render import psnr_db
from pipeline.scene.gaussians import Gaussians

CLUSTERS, CLUSTER_RADIUS_M = 300, 0.4


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
    color_ratio: float
    """To the exact frame timed in turns with it."""
    dominance_ratio: float
    errors: Errors


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

    if np.array_equal(a, b):
        return 1.0
    a, b = np.clip(a, 0, 1).astype(np.float64), np.clip(b, 0, 1).astype(np.float64)
    mean_a, mean_b = smooth(a), smooth(b)
    var_a, var_b = smooth(a * a) - mean_a**2, smooth(b * b) - mean_b**2
    both = smooth(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    top = (2 * mean_a * mean_b + c1) * (2 * both + c2)
    return float(np.mean(top / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))))


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
