"""D^T: for every Gaussian the views it dominates a pixel of, as compressed rows without values.

Scores of clusters read only the rows of their members, so a question costs the same in a scene of any size. The two
arrays are all there is, so they lie in Ray's object store as well as anywhere and every process reads them there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32, Int64, UInt16, UInt32


@dataclass(frozen=True, slots=True)
class Transposed:
    """The sparse 0/1 matrix D^T, M x N."""

    views: UInt16[np.ndarray, "E"] | UInt32[np.ndarray, "E"]
    """Views of Gaussian 0 ascending, then those of Gaussian 1, and so on."""
    starts: Int64[np.ndarray, "M1"]
    """Where each Gaussian's views begin, and the end: M + 1 numbers."""
    count: int
    """N."""

    @classmethod
    def of(cls, rows: Sequence[Int32[np.ndarray, "_"]], gaussians: int) -> Transposed:
        """Return D^T of the N rows of D, each of distinct ids below M = `gaussians`.

        Holds nothing of its size beside itself: rows are read one at a time, twice.
        """
        from pipeline.query.transposed_kernels import add_row, fill_row

        starts = np.zeros(gaussians + 1, np.int64)
        for row in rows:
            add_row(row, starts[1:])
        np.cumsum(starts, out=starts)
        # Two bytes a view where they do: at a hundred million entries that is 200 MB less.
        views = np.empty(starts[-1], np.uint16 if len(rows) <= 1 << 16 else np.uint32)
        places = starts[:-1].copy()
        for view, row in enumerate(rows):
            fill_row(row, view, places, views)
        return cls(views, starts, len(rows))

    @property
    def nbytes(self) -> int:
        """Size of both arrays, bytes."""
        return self.views.nbytes + self.starts.nbytes

    def counts(self, clusters: Iterable[Int32[np.ndarray, "_"]]) -> Int64[np.ndarray, "L N"]:
        """Return how many Gaussians of each of L clusters dominate a pixel of each view: C^T D^T.

        Args:
            clusters: Distinct Gaussian indices, 0 to M - 1, of each cluster; clusters may overlap.
        """
        from pipeline.query.transposed_kernels import count_members

        held = list(clusters)
        bounds = np.concatenate([[0], np.cumsum([len(cluster) for cluster in held], dtype=np.int64)])
        members = np.concatenate([np.empty(0, np.int32), *held])
        assert not len(members) or (members.min() >= 0 and members.max() < len(self.starts) - 1)
        found = np.zeros((len(held), self.count), np.int64)
        count_members(members, bounds, self.starts, self.views, found)
        return found
