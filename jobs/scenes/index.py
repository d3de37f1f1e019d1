"""The visibility index of a scene built ahead of any run, into a folder that jobs name as `visibility`."""

from __future__ import annotations

import time
from dataclasses import dataclass

from jobs.runs.progress import Progress, Silent
from pipeline.query.visibility import VisibilityConfig
from workers.index_steps import VIEWS_A_PART


@dataclass(frozen=True, slots=True)
class BuiltIndex:
    """What a build did."""

    folder: str
    """Where the rows lie."""
    stored: int
    """Views that were found there."""
    rendered: int
    """Views that were rendered."""
    seconds: float
    """Wall seconds of rendering and storing them."""
    nbytes: int
    """Size of all the scene's rows, bytes."""

    @property
    def views(self) -> int:
        """N."""
        return self.stored + self.rendered


def build_index(
    scene: str,
    folder: str,
    config: VisibilityConfig,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> BuiltIndex:
    """Render the views of a scene that a folder lacks, and store their rows there.

    Args:
        scene: Scene folder, a path or URI.
        folder: Where the index lies, a path or URI; made where it does not exist.
        config: Size and near plane of the renders.
        threads: Views rendered side by side.
        progress: Who is told how it goes; None for nobody.

    Raises:
        InputError: The scene is wrong, or the folder may not be read or written.
        RetryError: A remote store failed to answer.
    """
    from pipeline.query.visibility import VisibilityIndex
    from pipeline.query.visibility_store import VisibilityStore
    from pipeline.render import prepare
    from pipeline.scene.load import load_scene

    shown, loaded = progress or Silent(), load_scene(scene)
    cameras = [view.camera for view in loaded.views]
    store = VisibilityStore.of(folder, loaded.gaussians, cameras, config)
    found = store.read()
    missing = [view for view in range(len(cameras)) if view not in found.ids]
    nbytes = sum(ids.nbytes for ids in found.ids.values())
    shown.begin(len(cameras), len(found.ids))
    for message in found.damaged:
        shown.say(f"rendered again, since a part is damaged: {message}")
    start = time.perf_counter()
    gaussians = prepare(loaded.gaussians) if missing else None
    for first in range(0, len(missing), VIEWS_A_PART):
        assert gaussians is not None
        views = missing[first : first + VIEWS_A_PART]
        # An index of these views alone, so that only their rows are in memory.
        part = VisibilityIndex(gaussians, [cameras[view] for view in views], config)
        part.build(threads)
        store.write({view: part.ids(number) for number, view in enumerate(views)})
        nbytes += part.nbytes
        for _ in views:
            shown.advance("")
    seconds = time.perf_counter() - start
    return BuiltIndex(folder, len(found.ids), len(missing), seconds, nbytes)
