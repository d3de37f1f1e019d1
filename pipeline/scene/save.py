"""Scenes to a folder or URI, in the files `load_scene` reads."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.scene.captures import transforms_json
from pipeline.scene.formats import save_gaussians
from pipeline.scene.objects import SceneObject
from pipeline.scene.objects_file import objects_json
from pipeline.scene.scene import Scene
from pipeline.scene.scene_file import OBJECTS, SCENE, SEMANTICS, TRANSFORMS, SceneFile
from pipeline.scene.text_embeddings import FILE as TEXTS
from pipeline.scene.text_embeddings import text_embeddings_npz
from schemas.semantics_table import SemanticsTable, write_semantics
from schemas.storage import join, remove, write_bytes_atomic

GAUSSIANS = "gaussians.ply"


def save_scene(scene: Scene, path: str, objects: Sequence[SceneObject] = ()) -> None:
    """Write a scene folder: gaussians.ply, transforms.json, semantics.parquet, objects.json and scene.json.

    Every file is written atomically and scene.json last, so a folder that has one is whole; files of a scene saved
    there before are replaced or removed. Photographs are referred to, not copied. Gaussians and semantics come back
    bit for bit; poses to float64 rounding.

    Args:
        scene: The scene.
        path: Folder or URI; made where it is missing.
        objects: Ground-truth objects; none writes no objects.json.

    Raises:
        InputError: The place may not be written.
        RetryError: A remote store failed to answer.
    """
    path = str(path)
    for name in (SCENE, SEMANTICS, OBJECTS, TEXTS):
        remove(join(path, name))
    save_gaussians(scene.gaussians, join(path, GAUSSIANS))
    write_bytes_atomic(join(path, TRANSFORMS), transforms_json(scene.views, path))
    meaning = scene.semantics
    if len(meaning):
        table = SemanticsTable(meaning.vocabulary, meaning.category, meaning.embedding, meaning.instance)
        write_semantics(table, join(path, SEMANTICS))
    if scene.texts is not None:
        write_bytes_atomic(join(path, TEXTS), text_embeddings_npz(scene.texts))
    if objects:
        write_bytes_atomic(join(path, OBJECTS), objects_json(objects))
    x, y, z = (float(value) for value in scene.up)
    file = SceneFile(name=scene.name, up=(x, y, z), gaussians=GAUSSIANS, cameras=TRANSFORMS)
    write_bytes_atomic(join(path, SCENE), file.model_dump_json(indent=1).encode())
