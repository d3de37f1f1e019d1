"""Scenes from a folder or URI: Gaussians, views and semantics, brought to one convention and one order."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from pipeline.scene.captures import ViewsFile, read_colmap, read_nerfstudio
from pipeline.scene.formats import read_gaussians
from pipeline.scene.objects import SceneObject
from pipeline.scene.objects_file import read_objects
from pipeline.scene.scene import Scene
from pipeline.scene.scene_file import METRES, OBJECTS, SceneParts, find_parts
from pipeline.scene.semantics import Semantics
from pipeline.scene.text_embeddings import read_text_embeddings
from schemas.errors import InputError
from schemas.semantics_table import read_semantics
from schemas.storage import exists, join

UNIT_NORM_TOLERANCE = 1e-2
"""Embeddings whose norm is nearer to 1 than this are taken as they are: float16 alone moves it by 1e-3."""


def load_scene(uri: str) -> Scene:
    """Return the scene in a folder or at a URI.

    Gaussians no renderer can use and views with a broken pose are left out; `Scene.warnings` counts them.

    Raises:
        InputError: A part is missing or wrong, rows of semantics and Gaussians differ, or no view or no Gaussian
            is usable.
        RetryError: A remote store failed to answer.
    """
    parts = find_parts(uri)
    splats = read_gaussians(parts.gaussians)
    views = read_views(parts)
    semantics, notes = load_semantics(parts.semantics, splats.kept)
    up = np.array(parts.file.up)
    return Scene(
        name=parts.name,
        gaussians=splats.gaussians,
        views=views.views,
        semantics=semantics,
        up=up / np.linalg.norm(up),
        texts=None if parts.texts is None else read_text_embeddings(parts.texts),
        warnings=(*splats.warnings, *views.warnings, *notes, *unit_notes(parts)),
    )


def load_objects(uri: str) -> tuple[SceneObject, ...]:
    """Return the ground-truth objects of a scene folder; empty where it has no objects.json.

    Raises:
        InputError: objects.json is wrong.
        RetryError: A remote store failed to answer.
    """
    at = join(str(uri), OBJECTS)
    return read_objects(at) if exists(at) else ()


def read_views(parts: SceneParts) -> ViewsFile:
    """Return the usable views of a scene.

    Raises:
        InputError: There are no cameras, their file is wrong, or no pose is usable.
    """
    if parts.cameras is None:
        raise InputError(
            parts.name, field="cameras", expected="transforms.json or a COLMAP model in sparse/0", found="neither"
        )
    if parts.cameras.endswith(".json"):
        return read_nerfstudio(parts.cameras, strict=False)
    return read_colmap(parts.cameras, images=parts.images, strict=False)


def load_semantics(uri: str | None, kept: Bool[np.ndarray, "F"]) -> tuple[Semantics, tuple[str, ...]]:
    """Return the semantics of the Gaussians that were kept, and notes on what was mended.

    Args:
        uri: semantics.parquet; None gives empty semantics.
        kept: Which of the splat file's Gaussians are used.

    Raises:
        InputError: The table is wrong, has another number of rows than the splat file, or holds NaN.
    """
    if uri is None:
        return Semantics(()), ("no semantics.parquet: no category can be activated",)
    table = read_semantics(uri)
    columns = (table.category, table.embedding, table.instance)
    rows = next(len(column) for column in columns if column is not None)
    if rows != len(kept):
        raise InputError(uri, expected=f"{len(kept)} rows, one a Gaussian of the splat file", found=rows)
    category, embedding, instance = (column if column is None or kept.all() else column[kept] for column in columns)
    notes: tuple[str, ...] = ()
    if embedding is not None:
        embedding, notes = _unit_rows(uri, embedding)
    try:
        return Semantics(table.vocabulary, category, embedding, instance), notes
    except InputError as error:
        raise InputError(uri, field=error.field, expected=error.expected, found=error.found) from error


def unit_notes(parts: SceneParts) -> tuple[str, ...]:
    """Return a line where a scene says it is not in metres."""
    if parts.file.units.lower() in METRES:
        return ()
    return (f"units are {parts.file.units!r}: distances of the method are taken as metres",)


def _unit_rows(uri: str, embedding: Float[np.ndarray, "M D"]) -> tuple[Float[np.ndarray, "M D"], tuple[str, ...]]:
    norms = np.empty(len(embedding), np.float64)
    # In slices: a float64 copy of every embedding at once would be four times the table.
    for start in range(0, len(embedding), 1 << 16):
        rows = embedding[start : start + (1 << 16)].astype(np.float32)
        norms[start : start + len(rows)] = np.sqrt((rows * rows).sum(axis=1, dtype=np.float64))
    if not np.isfinite(norms).all():
        bad = int((~np.isfinite(norms)).sum())
        raise InputError(uri, field="embedding", expected="finite numbers", found=f"{bad} rows with NaN or infinity")
    off = (norms > 0) & (np.abs(norms - 1) > UNIT_NORM_TOLERANCE)
    if not off.any():
        return embedding, ()
    scaled = embedding / np.where(norms > 0, norms, 1.0).astype(embedding.dtype)[:, None]
    return scaled, (f"normalised {int(off.sum())} of {len(norms)} embeddings to unit length",)
