"""Labelled point clouds: a ScanNet scan's vertices with their annotation, or the arrays of an NPZ file."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int32

from pipeline.construct.mesh.scannet_mesh import read_scan, scan_objects
from pipeline.scene.objects import SceneObject
from pipeline.scene.semantics import UNLABELLED
from schemas import storage
from schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class LabelledPoints:
    """P points and what they belong to.

    Raises:
        InputError: Coordinates are not finite, an id is under -1 or outside the vocabulary, or neither categories nor
            instances are given.
    """

    points: Float[np.ndarray, "P 3"]
    """Positions in the scene's coordinates, metres."""
    vocabulary: tuple[str, ...] = ()
    """Category names; `category` indexes it."""
    category: Int32[np.ndarray, "P"] | None = None
    """Category id, -1 unlabelled; None: unknown."""
    instance: Int32[np.ndarray, "P"] | None = None
    """Instance id, -1 unlabelled, which scores ignore: walls and floors need ids, too. None: unknown."""
    objects: tuple[SceneObject, ...] = ()
    """The instances as objects; empty where the source has none."""
    warnings: tuple[str, ...] = ()
    """What the source holds that could not be used, one line each."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.points).all():
            bad = int((~np.isfinite(self.points).all(axis=1)).sum())
            raise InputError("points", expected="finite coordinates", found=f"{bad} points with others")
        if self.category is None and self.instance is None:
            raise InputError("points", expected="a category or an instance of each point", found="neither")
        for name, ids, end in (
            ("category", self.category, len(self.vocabulary)),
            ("instance", self.instance, np.iinfo(np.int32).max),
        ):
            if ids is None:
                continue
            low, high = int(ids.min()), int(ids.max())
            if low < UNLABELLED or high >= end:
                raise InputError("points", field=name, expected=f"ids from -1 to {end - 1}", found=f"{low} to {high}")


def read_labelled_points(path: str | Path) -> LabelledPoints:
    """Return the points of a ScanNet scan's folder, or of an NPZ file.

    A scan gives the vertices of its mesh, unaligned as they are in the file. An NPZ file holds `points` (P, 3) float,
    and `instance` (P,), or `category` (P,) with `vocabulary` (C,) of texts, or all; ids are integers, -1 unlabelled.

    Raises:
        InputError: The source is missing, or a part of it is wrong. Pickled objects are refused.
        RetryError: A remote store failed to answer.
    """
    if str(path).endswith(".npz"):
        return _read_npz(str(path))
    _, mesh, labels, yaw = read_scan(Path(path))
    objects, _ = scan_objects(mesh, labels, yaw)
    return LabelledPoints(mesh.vertices, labels.vocabulary, labels.category, labels.instance, objects, labels.warnings)


def _read_npz(uri: str) -> LabelledPoints:
    data = storage.read_bytes(uri)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(uri, expected="an NPZ file of plain arrays", found=str(error)) from error
    kinds = {"points": "f", "category": "iu", "instance": "iu", "vocabulary": "U"}
    for name, array in arrays.items():
        if array.dtype.kind not in kinds.get(name, ""):
            expected = "points (float), category and instance (integers), vocabulary (texts)"
            raise InputError(uri, field=name, expected=expected, found=array.dtype)
    points = arrays.get("points", np.empty(0))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(uri, field="points", expected="(P, 3) coordinates of at least one point", found=points.shape)
    if ("category" in arrays) != ("vocabulary" in arrays):
        raise InputError(uri, expected="category and vocabulary together", found=", ".join(sorted(arrays)))
    ids: dict[str, Int32[np.ndarray, "_"]] = {}
    for name in {"category", "instance"} & set(arrays):
        if arrays[name].shape != (len(points),):
            raise InputError(uri, field=name, expected=f"{len(points)} ids", found=arrays[name].shape)
        ids[name] = arrays[name].astype(np.int32)
        if (ids[name] != arrays[name]).any():
            raise InputError(uri, field=name, expected="ids that fit 32 bits", found=int(arrays[name].max()))
    vocabulary = tuple(str(name) for name in arrays.get("vocabulary", np.empty(0, str)).ravel())
    try:
        return LabelledPoints(points, vocabulary, ids.get("category"), ids.get("instance"))
    except InputError as error:
        raise InputError(uri, field=error.field, expected=error.expected, found=error.found) from error
