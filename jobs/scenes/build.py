"""New scene folders: generated apartments and ScanNet scans, each with questions computed from its objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schemas import storage
from schemas.question_file import save_questions

if TYPE_CHECKING:
    from pipeline.scene.objects import SceneObject
    from pipeline.scene.scene import Scene


SCAN_GROUNDING = {"single": 45, "multi": 12, "zero": 8, "referring": 20}
"""Most grounding questions about a scan: ScanRefer asks tens of a scene, and few of ours are needed for the rest."""


@dataclass(frozen=True, slots=True)
class BuiltScene:
    """A scene folder that was written."""

    uri: str
    """Path or URI."""
    gaussians: int
    """M."""
    views: int
    """N."""
    objects: int
    """Ground-truth objects."""
    questions: int
    """Questions written."""


def build_procedural(
    seed: int, output: str, *, gaussians: int = 80_000, rooms: int = 4, views: int = 120, name: str = ""
) -> BuiltScene:
    """Generate an apartment with questions into a folder.

    Args:
        seed: Fixes layout, furniture, path and questions.
        output: Folder or URI.
        gaussians: M.
        rooms: Rooms.
        views: N, views on the walked path.
        name: Name of the scene; empty takes the folder's.
    """
    import dataclasses

    from pipeline.scene.procedural import build_apartment

    made = build_apartment(seed, rooms=rooms, gaussians=gaussians, views=views)
    scene = dataclasses.replace(made.scene, name=name or storage.name_of(output))
    return _write(scene, made.objects, made.rooms, output, seed)


def build_scan(directory: Path, output: str, *, views: int = 120, seed: int = 0) -> BuiltScene:
    """Turn a ScanNet scan into a scene folder with questions.

    Args:
        directory: Folder with the scan's mesh, labels, segments and aggregation.
        output: Folder or URI.
        views: N, views on a generated path through free space.
        seed: Fixes path and questions.

    Raises:
        InputError: The scan lacks a file or one is wrong.
    """
    from pipeline.construct.mesh.scannet_mesh import build_scannet_mesh

    scene, objects = build_scannet_mesh(directory, views=views)
    return _write(scene, objects, (), output, seed, **SCAN_GROUNDING)


def _write(
    scene: Scene, objects: Sequence[SceneObject], rooms: Sequence[Any], output: str, seed: int, **most: int
) -> BuiltScene:
    from pipeline.scene.questions import generate_questions
    from pipeline.scene.save import save_scene
    from pipeline.scene.scene_file import QUESTIONS

    questions = generate_questions(scene.name, objects, rooms, np.random.default_rng(seed), **most)
    # Questions first: save_scene writes scene.json last, and a folder that has one is whole.
    save_questions(questions, storage.join(output, QUESTIONS))
    save_scene(scene, output, objects)
    return BuiltScene(output, len(scene.gaussians), len(scene.views), len(objects), len(questions))
