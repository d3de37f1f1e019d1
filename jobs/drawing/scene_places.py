"""Where the scene files of a run lie now: reports are often made elsewhere than the run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from jobs.dataset import scene_sha256
from schemas import storage
from schemas.errors import SplatReasonerError
from schemas.plan_columns import plan_table


@dataclass(frozen=True, slots=True)
class PlannedScene:
    """A scene as the plan names it."""

    name: str
    """Name in the rows."""
    uri: str
    """Path or URI when it was planned."""
    sha256: str
    """Hash of its files then."""


@dataclass(frozen=True, slots=True)
class ScenePlace:
    """A scene that was found, or why not."""

    uri: str
    """Path or URI; empty where it was not found."""
    problem: str = ""
    """Why nothing can be drawn from it; empty where it can."""


def planned_scenes(run: str) -> dict[str, PlannedScene]:
    """Return the scenes of a run by name, in plan order."""
    found: dict[str, PlannedScene] = {}
    table = plan_table(run, ("scene", "scene_uri", "scene_sha256"))
    distinct = table.group_by(["scene", "scene_uri", "scene_sha256"], use_threads=False).aggregate([])
    for row in distinct.to_pylist():
        found.setdefault(row["scene"], PlannedScene(row["scene"], row["scene_uri"], row["scene_sha256"]))
    return found


def find_scene(run: str, scene: PlannedScene, folder: str = "") -> ScenePlace:
    """Return where a scene lies, if its files are still those that were planned.

    Args:
        run: Run folder.
        scene: The scene.
        folder: A folder to look in for a folder of the scene's name; empty for the places the plan leads to: its path
            as it is, and, where that is relative, below each folder above the run.
    """
    tried = f"no folder of that name in {folder}" if folder else "the plan's path is not here"
    for uri in _places(run, scene, folder):
        try:
            if not storage.exists(uri):
                continue
            if scene_sha256(uri) == scene.sha256:
                return ScenePlace(uri)
            tried = "its files have changed since the run was planned"
        except SplatReasonerError as error:
            tried = str(error)
    return ScenePlace("", f"The files of scene {scene.name} cannot be used: {tried}.")


def _places(run: str, scene: PlannedScene, folder: str) -> Iterator[str]:
    if folder:
        yield storage.join(folder, storage.name_of(scene.uri))
        yield storage.join(folder, scene.name)
        return
    yield scene.uri
    path, here = storage.local_path(scene.uri), storage.local_path(run)
    if path is not None and here is not None and not path.is_absolute():
        for above in here.resolve().parents:
            yield str(above / path)
