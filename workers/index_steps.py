"""The visibility index as workers share it: read from disk, rendered in parts, joined once and adopted everywhere.

What is rendered is stored at once, so no later run and no other driver renders it again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int32, Int64

if TYPE_CHECKING:
    from pipeline.config import MethodConfig
    from pipeline.query.transposed import Transposed
    from pipeline.query.visibility_store import VisibilityStore
    from pipeline.scene.scene import Scene
    from pipeline.tasks.method import SceneContext

VIEWS_A_PART = 32
"""Rows committed together: a killed worker loses some seconds of rendering, and a thousand views are few files."""


@dataclass(frozen=True, slots=True)
class IndexPart:
    """Rows of the visibility index, in three arrays: many small ones would cost more to pass on than to use."""

    views: Int32[np.ndarray, "n"]
    """Views, numbered as in the scene."""
    starts: Int64[np.ndarray, "n+1"]
    """Where the ids of each view begin."""
    ids: Int32[np.ndarray, "_"]
    """Dominant Gaussians of all these views."""

    @classmethod
    def of(cls, rows: Mapping[int, Int32[np.ndarray, "_"]]) -> IndexPart:
        """Return rows, given by view, in one piece."""
        starts = np.concatenate([[0], np.cumsum([len(ids) for ids in rows.values()], dtype=np.int64)])
        ids = np.concatenate([np.empty(0, np.int32), *rows.values()])
        return cls(np.fromiter(rows, np.int32, len(rows)), starts, ids)

    def rows(self) -> dict[int, Int32[np.ndarray, "_"]]:
        """Return the ids by view, without a copy."""
        bounds = zip(self.views.tolist(), self.starts[:-1], self.starts[1:], strict=True)
        return {view: self.ids[start:end] for view, start, end in bounds}


@dataclass(slots=True)
class Unstored:
    """What the disk lacks of a scene's index."""

    store: VisibilityStore | None
    """Where it belongs; None where no index is read."""
    views: Sequence[int]
    """Views without a row there."""


@dataclass(frozen=True, slots=True)
class FoundIndex:
    """What the disk holds of a scene's index, and what it lacks."""

    rows: Mapping[int, Int32[np.ndarray, "_"]]
    """Dominant Gaussians by view."""
    unstored: Unstored
    """The rest."""
    damaged: tuple[str, ...]
    """What was wrong with parts that were removed."""


NO_INDEX = FoundIndex({}, Unstored(None, ()), ())
"""What is found for a method that reads no index."""


def read_index(scene: Scene, config: MethodConfig, folder: str) -> FoundIndex:
    """Return the rows of a scene's index that lie in a folder, of the views that the config uses."""
    from pipeline.query.view_subset import spread_views
    from pipeline.query.visibility_store import VisibilityStore

    cameras, settings = [view.camera for view in scene.views], config.visibility
    store = VisibilityStore.of(folder, scene.gaussians, cameras, settings)
    stored = store.read()
    used = spread_views(cameras, settings.every_nth, settings.most_views)
    rows = {view: stored.ids[view] for view in used if view in stored.ids}
    return FoundIndex(rows, Unstored(store, [view for view in used if view not in rows]), stored.damaged)


def adopt_rows(context: SceneContext, config: MethodConfig, rows: Mapping[int, Int32[np.ndarray, "_"]]) -> None:
    """Take over rows, by view: they are not rendered in this context."""
    index = context.index(config.visibility)
    for view, ids in rows.items():
        index.adopt(view, ids)


def index_views(context: SceneContext, config: MethodConfig, unstored: Unstored, part: int, parts: int) -> IndexPart:
    """Render and store every `parts`-th of the missing views, from number `part` on, and return their rows.

    Nothing is rendered ahead where the config says so.
    """
    views = () if config.visibility.build == "lazy" else unstored.views[part::parts]
    assert unstored.store is not None
    rows: dict[int, Int32[np.ndarray, "_"]] = {}
    for start in range(0, len(views), VIEWS_A_PART):
        index = context.index(config.visibility)  # prepares the scene, so not before there is a view to render
        some = {view: index.ids(view) for view in views[start : start + VIEWS_A_PART]}
        unstored.store.write(some)
        rows |= some
    return IndexPart.of(rows)


def keep_rows(context: SceneContext, config: MethodConfig, unstored: Unstored) -> int:
    """Store the rows that this context has rendered since; return how many."""
    index = context.index(config.visibility)
    held = {view: ids for view in unstored.views if (ids := index.held(view)) is not None}
    assert unstored.store is not None
    unstored.store.write(held)
    unstored.views = [view for view in unstored.views if view not in held]
    return len(held)


def join_index(scene: Scene, config: MethodConfig, parts: Sequence[IndexPart]) -> Transposed | IndexPart:
    """Return all rows the way scores read them; as they are where views are still to be rendered when needed."""
    from pipeline.query.transposed import Transposed

    rows: dict[int, Int32[np.ndarray, "_"]] = {}
    for part in parts:
        rows |= part.rows()
    if config.visibility.build == "lazy":
        return IndexPart.of(rows)
    # Views in no part are those that the config leaves out.
    nothing = np.empty(0, np.int32)
    return Transposed.of([rows.get(view, nothing) for view in range(len(scene.views))], len(scene.gaussians))


def adopt_index(context: SceneContext, config: MethodConfig, joined: Transposed | IndexPart) -> None:
    """Take over what `join_index` gave: nothing of it is rendered or copied in this context."""
    if isinstance(joined, IndexPart):
        adopt_rows(context, config, joined.rows())
    else:
        context.index(config.visibility).adopt_transposed(joined)
