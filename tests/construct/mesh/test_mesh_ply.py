"""The mesh reader: what it reads, and one clear line for each way a file can be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.mesh.mesh_ply import read_mesh, read_vertex_labels
from schemas.errors import InputError
from tests.construct.scan import build_arrays, ply_bytes

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
COLORS = np.arange(12, dtype=np.uint8).reshape(4, 3)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


@pytest.fixture
def good() -> bytes:
    return ply_bytes(VERTICES, COLORS, FACES, np.array([5, 6, 7, 8]))


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "mesh.ply"
    path.write_bytes(data)
    return path


def test_read_mesh_gives_back_what_was_written(tmp_path: Path, good: bytes) -> None:
    mesh = read_mesh(written(tmp_path, good))
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.colors, COLORS)
    np.testing.assert_array_equal(mesh.faces, FACES)


def test_read_vertex_labels_gives_the_label_of_each_vertex(tmp_path: Path, good: bytes) -> None:
    assert read_vertex_labels(written(tmp_path, good)).tolist() == [5, 6, 7, 8]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"binary_little_endian", b"ascii", "binary_little_endian 1.0"),
        (b"ply\n", b"plx\n", "a PLY header"),
        (b"end_header\n", b"end_headex\n", "a PLY header"),
        (b"property float y", b"property flaot y", "line 6"),
        (b"property float y", b"property float q", "y: expected"),
        (b"property uchar red", b"property char red", "8-bit"),
        (b"element face 2", b"element face 3", "face: expected 3 rows"),
        (b"element face 2", b"element face 1", "expected"),
        (b"element face 2", b"element fish 2", "face: expected at least one"),
        (b"vertex_indices", b"vertex_spices", "vertex_indices"),
    ],
)
def test_read_mesh_names_what_is_wrong(tmp_path: Path, good: bytes, old: bytes, new: bytes, said: str) -> None:
    assert old in good
    with pytest.raises(InputError) as caught:
        read_mesh(written(tmp_path, good.replace(old, new)))
    assert said in str(caught.value)
    assert "mesh.ply" in str(caught.value)


def test_read_mesh_refuses_polygons_that_are_no_triangles(tmp_path: Path, good: bytes) -> None:
    data = bytearray(good)
    data[-13] = 4
    with pytest.raises(InputError, match="triangles only, found 4 corners in row 1"):
        read_mesh(written(tmp_path, bytes(data)))


def test_read_mesh_refuses_an_index_beyond_the_vertices(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="indices below 4"):
        read_mesh(written(tmp_path, ply_bytes(VERTICES, COLORS, np.array([[0, 1, 4]]))))


def test_read_mesh_refuses_a_vertex_that_is_not_finite(tmp_path: Path) -> None:
    bad = VERTICES.copy()
    bad[2, 1] = np.nan
    with pytest.raises(InputError, match="vertex 2"):
        read_mesh(written(tmp_path, ply_bytes(bad, COLORS, FACES)))


def test_read_mesh_names_a_missing_file_and_missing_labels(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_mesh(tmp_path / "none.ply")
    with pytest.raises(InputError, match="label"):
        read_vertex_labels(written(tmp_path, ply_bytes(VERTICES, COLORS, FACES)))


@pytest.mark.parametrize("cut", [0, 3, 50, 200, 1000, -1])
def test_read_mesh_never_crashes_on_a_cut_file(tmp_path: Path, cut: int) -> None:
    vertices, colors, faces, _ = build_arrays()
    data = ply_bytes(vertices, colors, faces)
    with pytest.raises(InputError):
        read_mesh(written(tmp_path, data[:cut]))
