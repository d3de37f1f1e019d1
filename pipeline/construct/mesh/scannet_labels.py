"""ScanNet annotation: over-segmentation and aggregation to a category and an object per vertex."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int32

from schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class ScanNetLabels:
    """What each of n mesh vertices belongs to."""

    vocabulary: tuple[str, ...]
    """Raw label names, sorted."""
    category: Int32[np.ndarray, "n"]
    """Index into the vocabulary; -1 where nobody labelled."""
    instance: Int32[np.ndarray, "n"]
    """objectId as the file has it (0-based); -1 where nobody labelled."""
    names: dict[int, str]
    """Label of each objectId that has vertices."""
    warnings: tuple[str, ...]
    """Groups without vertices and segments claimed twice, one line each."""


def read_labels(segments: Path, aggregation: Path, vertices: int) -> ScanNetLabels:
    """Return the labels of a scan.

    Args:
        segments: `*_vh_clean_2.0.010000.segs.json`.
        aggregation: `*.aggregation.json`.
        vertices: Vertices of the mesh they are about.

    Raises:
        InputError: A file is missing or no JSON, a field is missing or of another type, or the files disagree on
            the number of vertices or the scene.
    """
    segment_file, groups_file = _read_json(segments), _read_json(aggregation)
    indices = _field(segments, segment_file, "segIndices", list)
    if not all(type(i) is int for i in indices):
        raise InputError(segments, field="segIndices", expected="whole numbers", found="something else")
    if len(indices) != vertices:
        raise InputError(
            segments, field="segIndices", expected=f"{vertices} entries, one a mesh vertex", found=len(indices)
        )
    first, second = _scene(segments, segment_file), _scene(aggregation, groups_file)
    if first != second:
        raise InputError(aggregation, field="sceneId", expected=first, found=second)
    groups = _field(aggregation, groups_file, "segGroups", list)
    owner: dict[int, int] = {}
    labels: dict[int, str] = {}
    warnings: list[str] = []
    for row, group in enumerate(groups):
        place = f"{aggregation} segGroups[{row}]"
        if not isinstance(group, dict):
            raise InputError(place, expected="a group", found=type(group).__name__)
        identity = _field(place, group, "objectId", int)
        if identity in labels:
            raise InputError(place, field="objectId", expected="an id no other group has", found=identity)
        labels[identity] = _field(place, group, "label", str).strip()
        for segment in _field(place, group, "segments", list):
            if owner.setdefault(segment, identity) != identity:
                warnings.append(f"segment {segment} belongs to objects {owner[segment]} and {identity}; kept the first")
    segment_ids, inverse = np.unique(np.array(indices, np.int64), return_inverse=True)
    unknown = sorted(set(owner) - set(segment_ids.tolist()))
    if unknown:
        raise InputError(aggregation, field="segments", expected=f"segments of {segments.name}", found=unknown[:5])
    instance = np.array([owner.get(int(i), -1) for i in segment_ids], np.int32)[inverse]
    present = set(np.unique(instance).tolist()) - {-1}
    warnings += [f"object {i} ({name}) has no vertices" for i, name in labels.items() if i not in present]
    names = {i: labels[i] for i in sorted(present)}
    vocabulary = tuple(sorted(set(names.values())))
    category_of = {i: vocabulary.index(name) for i, name in names.items()} | {-1: -1}
    ids, places = np.unique(instance, return_inverse=True)
    category = np.array([category_of[int(i)] for i in ids], np.int32)[places]
    return ScanNetLabels(vocabulary, category, instance, names, tuple(warnings))


def read_axis_alignment(path: Path) -> float | None:
    """Return the yaw in radians of a scan's `axisAlignment`, or None where its text file has none.

    Raises:
        InputError: The file is missing, or the alignment is no rigid rotation about the up axis.
    """
    if not path.is_file():
        raise InputError(path, expected="the scan's text file", found="no such file")
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, _, value = line.partition("=")
        if name.strip() == "axisAlignment":
            try:
                matrix = np.array([float(word) for word in value.split()]).reshape(4, 4)
            except ValueError as error:
                raise InputError(path, field="axisAlignment", expected="16 numbers", found=value.strip()) from error
            if not np.allclose(matrix[2, :3], [0, 0, 1], atol=1e-3) or not np.isfinite(matrix).all():
                raise InputError(path, field="axisAlignment", expected="a turn about z", found=value.strip())
            return float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    return None


def _read_json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(path, expected="a JSON file", found="no such file")
    try:
        value = json.loads(path.read_bytes())
    except ValueError as error:
        raise InputError(path, expected="JSON", found=str(error)) from error
    if not isinstance(value, dict):
        raise InputError(path, expected="a JSON object", found=type(value).__name__)
    return value


def _field(subject: object, record: dict[str, Any], name: str, kind: type) -> Any:
    if name not in record:
        raise InputError(subject, field=name, expected=f"a {kind.__name__}", found="no such field")
    if not isinstance(record[name], kind) or isinstance(record[name], bool):
        raise InputError(subject, field=name, expected=f"a {kind.__name__}", found=type(record[name]).__name__)
    return record[name]


def _scene(path: Path, record: dict[str, Any]) -> str:
    """Return the scene's id; some releases put "scannet." before it."""
    name: str = _field(path, record, "sceneId", str)
    return name.removeprefix("scannet.")
