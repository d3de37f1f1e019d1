"""Reads coloured triangle meshes from binary little-endian PLY files, strictly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int32, Shaped, UInt8

from schemas.errors import InputError

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "<i2", "int16": "<i2", "ushort": "<u2",
    "uint16": "<u2", "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4", "float": "<f4", "float32": "<f4",
    "double": "<f8", "float64": "<f8",
}  # fmt: skip
_LONGEST_HEADER = 1 << 16
"""Bytes: real headers take a few hundred."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """A triangle mesh of n vertices and m faces."""

    vertices: Float32[np.ndarray, "n 3"]
    """Positions, metres."""
    colors: UInt8[np.ndarray, "n 3"]
    """sRGB vertex colours."""
    faces: Int32[np.ndarray, "m 3"]
    """Vertex indices of each triangle."""


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    dtype: np.dtype[np.void]
    list_length: str
    """Name of the field that holds a list's length; empty for elements without a list."""


def read_mesh(path: Path) -> Mesh:
    """Return the mesh of a PLY file.

    Raises:
        InputError: The file is missing, not binary little-endian PLY, cut short or too long, lacks positions,
            colours or faces, has faces other than triangles, a vertex that is not finite or an index out of range.
    """
    elements = _read_elements(path)
    vertex, face = (_required(path, elements, name) for name in ("vertex", "face"))
    positions = np.stack([_column(path, vertex, axis) for axis in "xyz"], axis=1).astype(np.float32)
    colors = np.stack([_column(path, vertex, channel) for channel in ("red", "green", "blue")], axis=1)
    if colors.dtype != np.uint8:
        raise InputError(path, field="red, green, blue", expected="8-bit colours", found=colors.dtype)
    names = [name for name in ("vertex_indices", "vertex_index") if name in (face.dtype.names or ())]
    if not names:
        raise InputError(path, field="face", expected="a list property vertex_indices", found=face.dtype.names)
    faces = face[names[0]].astype(np.int64)
    if not np.isfinite(positions).all():
        row = int(np.flatnonzero(~np.isfinite(positions).all(axis=1))[0])
        raise InputError(path, field=f"vertex {row}", expected="finite coordinates", found=positions[row].tolist())
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(positions)):
        raise InputError(
            path, field="face", expected=f"indices below {len(positions)}", found=f"{faces.min()} to {faces.max()}"
        )
    return Mesh(positions, np.ascontiguousarray(colors), faces.astype(np.int32))


def read_vertex_labels(path: Path) -> Shaped[np.ndarray, "n"]:
    """Return the `label` property of a PLY file's vertices.

    Raises:
        InputError: As `read_mesh`, or there is no such property.
    """
    return _column(path, _required(path, _read_elements(path), "vertex"), "label")


def _read_elements(path: Path) -> dict[str, Shaped[np.ndarray, "_"]]:
    if not path.is_file():
        raise InputError(path, expected="a PLY file", found="no such file")
    data = path.read_bytes()
    end = data.find(b"end_header\n", 0, _LONGEST_HEADER)
    if not data.startswith(b"ply\n") or end < 0:
        raise InputError(path, expected="a PLY header", found=repr(data[:16]))
    offset = end + len(b"end_header\n")
    arrays: dict[str, Shaped[np.ndarray, "_"]] = {}
    for element in _parse_header(path, data[:end].decode("ascii", "replace").splitlines()):
        size = element.count * element.dtype.itemsize
        if offset + size > len(data):
            raise InputError(
                path,
                field=element.name,
                expected=f"{element.count} rows ({offset + size} bytes in all)",
                found=f"{len(data)} bytes",
            )
        array = np.frombuffer(data, element.dtype, element.count, offset)
        if element.list_length and not (array[element.list_length] == 3).all():
            row = int(np.flatnonzero(array[element.list_length] != 3)[0])
            found = f"{int(array[element.list_length][row])} corners in row {row}"
            raise InputError(path, field=element.name, expected="triangles only", found=found)
        arrays[element.name] = array
        offset += size
    if offset != len(data):
        raise InputError(path, expected=f"{offset} bytes", found=f"{len(data)}")
    return arrays


def _parse_header(path: Path, lines: list[str]) -> list[_Element]:
    if "format binary_little_endian 1.0" not in lines:
        found = next((line for line in lines if line.startswith("format")), "no format line")
        raise InputError(path, field="format", expected="binary_little_endian 1.0", found=found)
    elements: list[tuple[str, int, list[tuple[str, str] | tuple[str, str, tuple[int]]], str]] = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0] in ("ply", "format", "comment", "obj_info"):
            continue
        if words[0] == "element" and len(words) == 3 and words[2].isdigit():
            elements.append((words[1], int(words[2]), [], ""))
        elif words[0] == "property" and elements and len(words) == 3 and words[1] in _TYPES:
            elements[-1][2].append((words[2], _TYPES[words[1]]))
        elif words[:2] == ["property", "list"] and elements and len(words) == 5 and {*words[2:4]} <= {*_TYPES}:
            # A triangle's list has three entries, so its rows have one size; other lists are refused when read.
            name, count, fields, _ = elements[-1]
            length = f"length of {words[4]}"
            fields += [(length, _TYPES[words[2]]), (words[4], _TYPES[words[3]], (3,))]
            elements[-1] = (name, count, fields, length)
        else:
            raise InputError(f"{path} line {number}", expected="an element or property line", found=repr(line))
    return [_Element(name, count, np.dtype(fields), length) for name, count, fields, length in elements]


def _required(path: Path, elements: dict[str, Shaped[np.ndarray, "_"]], name: str) -> Shaped[np.ndarray, "_"]:
    if name not in elements or not len(elements[name]):
        raise InputError(path, field=name, expected="at least one", found="none")
    return elements[name]


def _column(path: Path, array: Shaped[np.ndarray, "_"], name: str) -> Shaped[np.ndarray, "_"]:
    if name not in (array.dtype.names or ()):
        raise InputError(path, field=name, expected="a vertex property", found=f"only {array.dtype.names}")
    return array[name]
