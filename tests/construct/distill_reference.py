"""The distillation written out: every point against every Gaussian, float64, one Gaussian at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.geometry import covariances
from pipeline.scene import Gaussians


class Brute(NamedTuple):
    label: np.ndarray
    purity: np.ndarray
    nearest: np.ndarray
    candidates: np.ndarray
    lead: np.ndarray
    """Share by which the winner leads the second label; 1 where there is no second."""


def brute_force(
    gaussians: Gaussians, points: np.ndarray, labels: np.ndarray, *, reach: float = 5.0, most: int = 1000
) -> Brute:
    """Return what `distill` should; Gaussians must not be flat."""
    inverse = np.linalg.inv(covariances(gaussians.quats, gaussians.log_scales))
    kinds = np.unique(labels)
    rows = []
    for mean, precision, log_scales in zip(gaussians.means, inverse, gaussians.log_scales, strict=True):
        offset = points.astype(np.float64) - mean.astype(np.float64)
        distance = np.sqrt((offset**2).sum(axis=1))
        order = np.lexsort((np.arange(len(points)), distance))[:most]
        near = order[distance[order] <= reach * np.exp(np.float64(log_scales.max()))]
        if not len(near):
            rows.append((-1, 0.0, np.inf, 0, 1.0))
            continue
        squared = np.einsum("ki,ij,kj->k", offset[near], precision, offset[near])
        weights = np.exp(-0.5 * (squared - squared.min()))
        sums = np.array([weights[labels[near] == kind].sum() for kind in kinds])
        second, first = np.sort(np.append(sums, 0.0))[-2:]
        winner = int(np.flatnonzero(sums >= first * (1 - 1e-9))[0])
        rows.append(
            (int(kinds[winner]), sums[winner] / sums.sum(), np.sqrt(squared.min()), len(near), 1 - second / first)
        )
    return Brute(*(np.array(column) for column in zip(*rows, strict=True)))
