"""What a camera file gave: the views that can be used, and those that cannot with the reason."""

from __future__ import annotations

import posixpath
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pipeline.geometry import Camera
from pipeline.scene.views import View
from schemas.errors import InputError
from schemas.storage import join, list_files


@dataclass(frozen=True, slots=True)
class ViewsFile:
    """Views read from one camera file or folder."""

    views: tuple[View, ...]
    """Usable views, in file order."""
    skipped: tuple[str, ...] = ()
    """One line for each frame whose pose cannot be used."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line that counts the skipped frames; none where nothing was skipped."""
        if not self.skipped:
            return ()
        total = len(self.views) + len(self.skipped)
        return (f"skipped {len(self.skipped)} of {total} views with an unusable pose; first: {self.skipped[0]}",)


def require_views(found: ViewsFile, subject: object) -> ViewsFile:
    """Return the views, or raise where none can be used.

    Raises:
        InputError: No view is usable.
    """
    if not found.views:
        first = f"; first: {found.skipped[0]}" if found.skipped else ""
        raise InputError(subject, expected="at least one usable view", found=f"none of {len(found.skipped)}{first}")
    return found


def camera_of(
    K: Float[np.ndarray, "3 3"], world_to_camera: Float[np.ndarray, "3 4"], width: int, height: int, subject: object
) -> Camera:
    """Return the camera, or raise with the file and frame in the message.

    Raises:
        InputError: Focal lengths or size are not positive.
    """
    try:
        return Camera(K, world_to_camera, width, height)
    except InputError as error:
        raise InputError(subject, field=error.field, expected=error.expected, found=error.found) from error


def view_names(paths: Sequence[str]) -> tuple[str, ...]:
    """Return a distinct name for each image path: its stem, or its whole path where stems repeat."""
    stems = [posixpath.splitext(posixpath.basename(path))[0] for path in paths]
    repeated = {stem for stem, count in Counter(stems).items() if count > 1}
    names = []
    for path, stem in zip(paths, stems, strict=True):
        whole = posixpath.splitext(path.removeprefix("./").strip("/"))[0].replace("/", "_")
        names.append(whole if stem in repeated else stem)
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name] += 1
        if seen[name] > 1:
            names[i] = f"{name}#{seen[name]}"
    return tuple(names)


class Photographs:
    """Which image files are at hand below a folder; each folder is listed once."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._listed: dict[str, frozenset[str]] = {}

    def find(self, path: str, suffixes: Sequence[str] = ("",)) -> str | None:
        """Return the path or URI of a file named by a capture, trying suffixes; None where it is absent."""
        parent, name = posixpath.split(path)
        alone = posixpath.isabs(path) or "://" in path
        folder = parent if alone else join(self._folder, *(part for part in parent.split("/") if part not in ("", ".")))
        if folder not in self._listed:
            self._listed[folder] = frozenset(list_files(folder))
        for suffix in suffixes:
            if name + suffix in self._listed[folder]:
                return join(folder, name + suffix)
        return None
