"""Labelled points from a scan's folder and from NPZ files, and one clear line for each way they can be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.construct.distillation.labelled_points import LabelledPoints, read_labelled_points
from schemas.errors import InputError
from tests.construct.scan import NAME, PARTS, YAW, build_arrays, write_scan

ARRAYS: dict[str, Any] = {
    "points": np.arange(12, dtype=np.float32).reshape(4, 3),
    "instance": np.array([0, 0, 5, -1]),
    "category": np.array([1, 1, 0, -1], np.int16),
    "vocabulary": np.array(["desk", "lamp"]),
}


def write(path: Path, **change: Any) -> Path:
    arrays = {name: array for name, array in (ARRAYS | change).items() if array is not None}
    np.savez(path / "points.npz", **arrays)
    return path / "points.npz"


def test_a_scan_gives_its_vertices_unaligned_with_annotation_and_objects(tmp_path: Path) -> None:
    folder = write_scan(tmp_path)
    cos, sin = np.cos(YAW), np.sin(YAW)
    (folder / f"{NAME}.txt").write_text(f"axisAlignment = {cos} {sin} 0 1 {-sin} {cos} 0 2 0 0 1 0 0 0 0 1\n")
    vertices, _, _, parts = build_arrays()
    found = read_labelled_points(folder)
    np.testing.assert_array_equal(found.points, vertices)
    np.testing.assert_array_equal(found.instance, parts)
    assert found.category is not None
    assert [found.vocabulary[i] for i in found.category] == [PARTS[part][0] for part in parts]
    assert [o.instance for o in found.objects] == list(range(len(PARTS)))


def test_an_npz_file_gives_its_arrays(tmp_path: Path) -> None:
    found = read_labelled_points(write(tmp_path))
    assert found.vocabulary == ("desk", "lamp")
    assert found.category is not None
    assert found.instance is not None
    assert found.category.tolist() == [1, 1, 0, -1]
    assert found.instance.tolist() == [0, 0, 5, -1]
    only = read_labelled_points(write(tmp_path, category=None, vocabulary=None))
    assert only.category is None
    assert only.vocabulary == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": None}, r"coordinates of at least one point, found \(0,\)"),
        ({"points": np.zeros((4, 2))}, r"coordinates of at least one point, found \(4, 2\)"),
        ({"points": np.full((4, 3), np.inf)}, "found 4 points with others"),
        ({"points": np.zeros((4, 3), int)}, "points: expected points .float"),
        ({"instance": np.zeros(3, int)}, r"instance: expected 4 ids, found \(3,\)"),
        ({"instance": np.full(4, -2)}, "instance: expected ids from -1 .* found -2 to -2"),
        ({"instance": np.full(4, 2**40)}, "ids that fit 32 bits"),
        ({"category": np.full(4, 2)}, "category: expected ids from -1 to 1, found 2 to 2"),
        ({"vocabulary": None}, "category and vocabulary together"),
        ({"category": None, "vocabulary": None, "instance": None}, "a category or an instance of each point"),
        ({"color": np.zeros(4)}, "color: expected points"),
        ({"instance": np.array([None] * 4)}, "NPZ file of plain arrays"),
    ],
)
def test_wrong_npz_files_are_refused_by_file_and_field(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = write(tmp_path, **change)
    with pytest.raises(InputError, match=message) as caught:
        read_labelled_points(path)
    assert str(path) in str(caught.value)


def test_what_is_no_npz_and_what_is_not_there_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(InputError, match=r"a\.npz"):
        read_labelled_points(tmp_path / "a.npz")
    for missing in ("b.npz", "b"):
        with pytest.raises(InputError, match="found no"):
            read_labelled_points(tmp_path / missing)


def test_points_made_in_memory_are_checked() -> None:
    with pytest.raises(InputError, match="neither"):
        LabelledPoints(np.zeros((1, 3)))
