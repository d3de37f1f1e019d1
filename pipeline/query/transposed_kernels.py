# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops over the compressed rows of D^T; one thread, since a row of D takes a tenth of a millisecond."""

from __future__ import annotations

from pipeline.cached_kernels import kernel


@kernel
def add_row(ids, counts):
    """Add 1 to counts (M,) at each of the ids (n,)."""
    for id_ in ids:
        counts[id_] += 1


@kernel
def fill_row(ids, view, places, views):
    """Write `view` to the next place (M,) of each id (n,) in views (nnz,), and move the places on."""
    for id_ in ids:
        views[places[id_]] = view
        places[id_] += 1


@kernel
def count_members(members, bounds, starts, views, counts):
    """Add to counts (L, N) how often each view stands in the rows of each cluster's members.

    Takes members (n,) and bounds (L + 1,) of the clusters in them, starts (M + 1,) and views (nnz,) of D^T.
    """
    for cluster in range(len(bounds) - 1):
        row = counts[cluster]
        for member in members[bounds[cluster] : bounds[cluster + 1]]:
            for place in range(starts[member], starts[member + 1]):
                row[views[place]] += 1
