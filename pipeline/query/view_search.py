"""The best recorded view of each cluster, from as few renders as a proof allows.

Views are kept by how much of the cluster they can show at most (`view_bounds`), the lower number first among equals.
The first of them is looked at again: its bound is brought up to date with the tiles that were rendered since, for
this cluster or for any other; if tiles are still open, some of them are rendered; then it goes back to its new place.
Once nothing is open in the view that comes first, its bound is its exact amount. No other view can show more, and
those that might show as much have higher numbers: so it is the arg max that the whole index gives, ties included.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Bool

from pipeline.query.initial_views import InitialView, initial_views
from pipeline.query.view_bounds import ClusterInViews, hull
from pipeline.query.visibility import WINDOW_COST, VisibilityCounts, Window

LAZY_SHARE = 0.25
"""Share of the cost of a whole index that may be spent before it is built: about what is lost at worst where it is
built in the end (10 to 40 % measured, benchmarks/skips.py)."""
PIECE = 1 / 5
"""Largest share of a view that is rendered before its bound is looked at again."""


def best_views(targets: Sequence[ClusterInViews]) -> tuple[InitialView, ...]:
    """Return what `initial_views` takes from the counts in all views, rendering no more than it takes.

    Args:
        targets: L clusters in the views of one index.
    """
    if builds_whole(targets):
        first = targets[0]
        return initial_views(first.index.counts([target.ids for target in targets], first.weights))
    return tuple(search(target) for target in targets)


def best_of_top(targets: Sequence[ClusterInViews], coarse: VisibilityCounts, top: int) -> tuple[InitialView, ...]:
    """Return for each cluster the best of the `top` views that another pass, at another size, found best.

    Args:
        targets: L clusters in the views that decide.
        coarse: Counts of that pass; only views that see something in it are looked at.
        top: How many.
    """
    chosen = []
    for target, scores in zip(targets, coarse.scores, strict=True):
        order = np.argsort(-scores, kind="stable")[:top]
        chosen.append(search(target, order[scores[order] > 0].tolist()))
    return tuple(chosen)


def builds_whole(targets: Sequence[ClusterInViews]) -> bool:
    """Return whether the best views of these clusters are read from the whole index, or from tiles as needed.

    The whole index is taken where it is there already, and by `VisibilityConfig.build`. "auto" compares costs in
    whole views: what searches have cost so far, plus every part that these clusters touch and that is not rendered,
    against `LAZY_SHARE` of all views.
    """
    if not targets:
        return False
    index = targets[0].index
    if not index.missing or index.config.build != "auto":
        return not index.missing or index.config.build == "all"
    budget, cost = LAZY_SHARE * len(index.views), 0.0
    for target in targets:
        cost += _cost(target)
        if index.work.searching + cost > budget:
            return True
    return False


def search(target: ClusterInViews, views: Collection[int] | None = None) -> InitialView:
    """Return the view that shows most of a cluster; ties go to the lowest number.

    Args:
        target: The cluster in the views of an index.
        views: Where to look; None for all views the index uses.
    """
    total = target.amount(target.ids)
    looked_at = target.index.views if views is None else views
    heap = [(-reach.most, view) for view in looked_at if (reach := target.reach(view)) is not None]
    heapq.heapify(heap)
    while heap and heap[0][0] < 0 < total:
        key, view = heapq.heappop(heap)
        prospect = target.prospect(view)
        if -prospect.most > key:
            heapq.heappush(heap, (-prospect.most, view))
        elif prospect.open.any():
            target.index.show(view, _piece(prospect.open))
            heapq.heappush(heap, (key, view))
        else:
            return InitialView(view, prospect.most / total, len(prospect.found))
    return InitialView(None, 0.0, 0)


def _piece(tiles: Bool[np.ndarray, "rows columns"]) -> Window:
    """Return a window that holds some of these tiles, small enough to be rendered at once: the fuller half, halved."""
    left, top, right, bottom = hull(tiles)
    while (right - left) * (bottom - top) > max(1, PIECE * tiles.size):
        if right - left >= bottom - top:
            middle = (left + right) // 2
            first = tiles[top:bottom, left:middle].sum() >= tiles[top:bottom, middle:right].sum()
            left, right = (left, middle) if first else (middle, right)
        else:
            middle = (top + bottom) // 2
            first = tiles[top:middle, left:right].sum() >= tiles[middle:bottom, left:right].sum()
            top, bottom = (top, middle) if first else (middle, bottom)
    inner = np.zeros_like(tiles)
    inner[top:bottom, left:right] = tiles[top:bottom, left:right]
    return hull(inner)


def _cost(target: ClusterInViews) -> float:
    """Cost of rendering every part of a view that a cluster touches, in whole views: its search costs no more."""
    cost = 0.0
    for view in target.index.views:
        reach = target.reach(view)
        if reach is None:
            continue
        left, top, right, bottom = reach.window
        done = target.index.part(view).done
        if not done[top:bottom, left:right].all():
            share = (right - left) * (bottom - top) / done.size
            cost += WINDOW_COST * np.ceil(share / PIECE) + share
    return cost
