"""Votes per pair of Gaussian and label: sparse, sorted, summed over frames within a bound of memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64

from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, top_contributors
from pipeline.scene.semantics import UNLABELLED

if TYPE_CHECKING:
    from scipy.sparse import csr_array

PAIR_BYTES = 32
"""Of a pair, 8 for key and sum each, twice while two lists are added."""
TIE = 1e-9
"""Labels whose sums differ by less than this share are tied: far above the rounding of a sum in another order."""


@dataclass(frozen=True, slots=True)
class Votes:
    """Summed weights of pairs of Gaussian and label; a label of -1 is silence, a pixel nobody labelled."""

    keys: Int64[np.ndarray, "n"]
    """gaussian << 32 | label + 1, rising."""
    sums: Float64[np.ndarray, "n"]
    """Summed weight of each pair, pixels."""

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def gaussians(self) -> Int64[np.ndarray, "n"]:
        """The Gaussian of each pair."""
        return self.keys >> 32

    @property
    def labels(self) -> Int64[np.ndarray, "n"]:
        """The label of each pair."""
        return (self.keys & 0xFFFFFFFF) - 1

    def plus(self, other: Votes) -> Votes:
        """Return the sums of both."""
        from pipeline.construct.semantics.register_kernels import add_sorted

        return Votes(*add_sorted(self.keys, self.sums, other.keys, other.sums))

    def without_silence(self) -> Votes:
        """Return the votes for labels alone."""
        named = self.labels != UNLABELLED
        return Votes(self.keys[named], self.sums[named])

    def gaussians_met(self) -> int:
        """Return how many Gaussians have any vote."""
        return int(np.count_nonzero(np.diff(self.gaussians))) + bool(len(self))

    def weight_of_each(self, count: int) -> Float64[np.ndarray, "M"]:
        """Return the summed weight of each of `count` Gaussians."""
        return _summed(self.gaussians, self.sums, count)

    def winners(
        self, count: int, silence: float
    ) -> tuple[Int32[np.ndarray, "M"], Float32[np.ndarray, "M"], Float64[np.ndarray, "M"]]:
        """Return each Gaussian's heaviest label, that label's share of all its votes, and their sum.

        Silence counts `silence` times its weight. It wins ties; of tied labels the one met first does. The label is -1
        and its share 0 where silence wins or nothing voted.
        """
        gaussians, labels = self.gaussians, self.labels
        sums = np.where(labels == UNLABELLED, silence * self.sums, self.sums)
        total, best = _summed(gaussians, sums, count), np.zeros(count)
        np.maximum.at(best, gaussians, sums)
        tied = np.flatnonzero((sums >= best[gaussians] * (1 - TIE)) & (sums > 0))
        winner, share = np.full(count, UNLABELLED, np.int32), np.zeros(count, np.float32)
        tied = tied[::-1]  # the last one written is the first of a Gaussian's pairs
        winner[gaussians[tied]] = labels[tied]
        named = winner != UNLABELLED
        share[named] = best[named] / total[named]
        return winner, share, total

    def matrix(self, start: int, stop: int, labels: int) -> csr_array:
        """Return the sums of Gaussians `start` to `stop` as a sparse float32 matrix with a column a label."""
        from scipy.sparse import csr_array

        rows = slice(*np.searchsorted(self.keys, np.array([start, stop]) << 32))
        edges = np.searchsorted(self.keys[rows], np.arange(start, stop + 1) << 32)
        columns = (self.keys[rows] & 0xFFFFFFFF) - 1
        return csr_array((self.sums[rows].astype(np.float32), columns, edges), shape=(stop - start, labels))


def _summed(ids: Int64[np.ndarray, "n"], sums: Float64[np.ndarray, "n"], count: int) -> Float64[np.ndarray, "M"]:
    # Of nothing at all numpy counts in whole numbers.
    return np.bincount(ids, sums, count).astype(np.float64, copy=False)


class VoteSums:
    """Adds votes frame by frame. Lists of like size are added to each other, so that each pair moves seldom.

    Args:
        most_pairs: Pairs held before the lightest are forgotten, 1 or more.
    """

    def __init__(self, most_pairs: int) -> None:
        self._cap = most_pairs
        self._runs: list[Votes] = []
        self._dropped = 0.0
        self.most_pairs = 0
        """Pairs held at once so far."""

    def add(self, votes: Votes) -> None:
        """Add the votes of the next frame."""
        self._runs.append(votes)
        self.most_pairs = max(self.most_pairs, self._held())
        while len(self._runs) > 1 and len(self._runs[-2]) <= 2 * len(self._runs[-1]):
            last = self._runs.pop()
            self._runs.append(self._runs.pop().plus(last))
        if self._held() > self._cap:
            self._forget()

    def total(self) -> Votes:
        """Return the sums so far."""
        while len(self._runs) > 1:
            last = self._runs.pop()
            self._runs.append(self._runs.pop().plus(last))
        return self._runs[0] if self._runs else Votes(np.empty(0, np.int64), np.empty(0))

    @property
    def forgotten(self) -> float:
        """Share of all weight that was dropped to stay within the bound, 0 to 1."""
        kept = sum(float(run.sums.sum()) for run in self._runs)
        return self._dropped / (kept + self._dropped) if self._dropped else 0.0

    def _held(self) -> int:
        return sum(len(run) for run in self._runs)

    def _forget(self) -> None:
        """Keep three quarters of the pairs there is room for: those that weigh most within their Gaussian."""
        whole = self.total()
        keep = max(1, 3 * self._cap // 4)
        if len(whole) <= keep:
            return
        gaussians = whole.gaussians
        share = whole.sums / np.bincount(gaussians, whole.sums)[gaussians]
        kept = np.sort(np.argsort(-share, kind="stable")[:keep])
        self._dropped += float(whole.sums.sum() - whole.sums[kept].sum())
        self._runs = [Votes(whole.keys[kept], whole.sums[kept])]


def frame_votes(
    prepared: PreparedGaussians,
    camera: Camera,
    labels: Int32[np.ndarray, "H W"],
    confidence: Float32[np.ndarray, "H W"] | None,
    contributors: int,
    first: int | None,
) -> Votes:
    """Return the votes of one frame: each pixel gives its label to its heaviest Gaussians, weighted alpha * T.

    Args:
        prepared: The scene.
        camera: Of the labels' size.
        labels: Label number of each pixel, -1 for silence.
        confidence: Factor on each labelled pixel; None for 1.
        contributors: Heaviest Gaussians of a pixel that take its label.
        first: Of its nearest so many contributions; None for all.
    """
    from pipeline.construct.semantics.register_kernels import tally

    top = top_contributors(prepared, camera, contributors, first=first)
    factor = np.empty(0, np.float32) if confidence is None else confidence.reshape(-1)
    keys, sums = tally(
        top.ids.reshape(-1, contributors),
        top.weights.reshape(-1, contributors),
        np.ascontiguousarray(labels).reshape(-1),
        np.ascontiguousarray(factor),
        len(prepared),
    )
    order = np.argsort(keys)
    return Votes(keys[order], sums[order])
