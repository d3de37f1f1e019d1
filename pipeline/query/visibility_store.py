"""The visibility index on disk: which rows of D a scene, its cameras and the render settings find there.

Keys are hashes of content. The space of a scene covers the Gaussians' geometry and the settings of the renders; a row
covers its view's lens, pose and size. So views added later extend what is stored, their order and names do not
matter, and nothing that differs in what a dominance render reads can meet a stale row. The file format is in
`schemas/visibility_table.py`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from pipeline.geometry import Camera
from pipeline.query.visibility import VisibilityConfig, fitted_to
from pipeline.scene.gaussians import Gaussians
from schemas import storage
from schemas.visibility_table import VERSION, VisibilitySpace, read_rows, write_rows

RENDERER_VERSION = 1
"""Raise when a change of the renderer changes a dominant id of any pixel; a test holds a scene's ids to it."""

SAME_ROWS = frozenset({"build", "long_side", "exact_top", "every_nth", "most_views"})
"""Settings that change no row of a view: when it is rendered and whether; a row's own key has the size. Any other one,
also one that is new, is part of the space's key."""


@dataclass(frozen=True, slots=True)
class StoredViews:
    """The rows of a scene's views that were found on disk."""

    ids: Mapping[int, Int32[np.ndarray, "_"]]
    """Dominant Gaussians by view, read-only."""
    damaged: tuple[str, ...]
    """What was wrong with parts that were removed; their rows count as missing."""


@dataclass(frozen=True, slots=True)
class VisibilityStore:
    """Rows of one scene's index in a folder that any number of runs and writers may share."""

    root: str
    """The folder, a path or URI; made when the first row is written."""
    space: VisibilitySpace
    """The scene and the settings of the renders."""
    keys: tuple[str, ...]
    """Key of each of the N views."""

    @classmethod
    def of(
        cls, root: str, gaussians: Gaussians, cameras: Iterable[Camera], config: VisibilityConfig
    ) -> VisibilityStore:
        """Return the store of a scene's rows; reads all of the geometry once, to hash it."""
        keys = tuple(view_key(fitted_to(camera, config.long_side)) for camera in cameras)
        return cls(root, space_of(gaussians, config), keys)

    def read(self) -> StoredViews:
        """Return the rows that are there, verified; a damaged part is removed, so that its rows are made again.

        Raises:
            InputError: The folder may not be read, or a damaged part not be removed.
            RetryError: A remote store failed to answer.
        """
        stored = read_rows(self.root, self.space)
        for uri in stored.damaged:
            storage.remove(uri)
        rows = {view: stored.ids[key] for view, key in enumerate(self.keys) if key in stored.ids}
        return StoredViews(rows, tuple(stored.damaged.values()))

    def write(self, rows: Mapping[int, Int32[np.ndarray, "_"]]) -> None:
        """Commit rows by view; nothing happens where there are none.

        Raises:
            InputError: The folder may not be written.
            RetryError: A remote store failed to answer.
        """
        if rows:
            write_rows(self.root, self.space, {self.keys[view]: ids for view, ids in rows.items()})


def space_of(gaussians: Gaussians, config: VisibilityConfig) -> VisibilitySpace:
    """Return what rows of a scene are shared under: colours do not count, geometry and settings do."""
    digest = hashlib.sha256()
    settings = {
        "renderer": RENDERER_VERSION,
        "table": VERSION,
        "gaussians": len(gaussians),
        "config": config.model_dump(mode="json", exclude=set(SAME_ROWS)),
    }
    digest.update(json.dumps(settings, sort_keys=True).encode())
    for array in (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits):
        digest.update(array.data)
    return VisibilitySpace(digest.hexdigest()[:32], len(gaussians))


def view_key(camera: Camera) -> str:
    """Return the hash of a camera's lens, pose and size."""
    digest = hashlib.sha256()
    digest.update(camera.K.tobytes())
    digest.update(camera.world_to_camera.tobytes())
    digest.update(np.array([camera.width, camera.height], np.int64).tobytes())
    return digest.hexdigest()
