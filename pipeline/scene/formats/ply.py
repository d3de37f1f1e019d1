"""Inria PLY, the format 3DGS trains to: one float property a parameter, in any order, with any extras beside them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from pipeline.scene.formats.ply_header import Element, Header, read_element
from pipeline.scene.formats.raw import REST_COUNTS, RawGaussians
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError

MEANS = ("x", "y", "z")
SCALES = ("scale_0", "scale_1", "scale_2")
QUATS = ("rot_0", "rot_1", "rot_2", "rot_3")
COLORS = ("f_dc_0", "f_dc_1", "f_dc_2")
OPACITY = ("opacity",)


def read_ply(data: bytes, header: Header, subject: object) -> RawGaussians:
    """Return the Gaussians of an Inria PLY; binary of either byte order, or ASCII.

    Raises:
        InputError: A property is missing, the number of f_rest properties fits no degree, or data are missing.
    """
    vertex = header.element("vertex")
    if vertex is None:
        names = [element.name for element in header.elements]
        raise InputError(subject, field="header", expected="an element 'vertex'", found=names or "no element")
    rest = _rest_names(vertex, subject)
    for name in (*MEANS, *SCALES, *QUATS, *OPACITY, *COLORS):
        if name not in vertex.names:
            raise InputError(
                subject, field=name, expected="a property of each vertex", found=f"only {_shortened(vertex.names)}"
            )
    rows = read_element(data, header, "vertex", subject)
    take = _Columns(rows, vertex).take
    sh = np.empty((vertex.count, 1 + len(rest) // 3, 3), np.float32)
    sh[:, 0] = take(COLORS)
    if rest:
        # Channel-major in the file: every red coefficient, then green, then blue.
        sh[:, 1:] = take(rest).reshape(vertex.count, 3, -1).transpose(0, 2, 1)
    return RawGaussians(take(MEANS), take(QUATS), take(SCALES), take(OPACITY)[:, 0].copy(), sh)


def ply_bytes(gaussians: Gaussians) -> bytes:
    """Return an Inria PLY with these Gaussians, bit for bit as `read_ply` gives them back."""
    count, rest = len(gaussians), gaussians.sh.shape[1] - 1
    names = [*MEANS, "nx", "ny", "nz", *COLORS, *(f"f_rest_{i}" for i in range(3 * rest)), *OPACITY, *SCALES, *QUATS]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    table = np.zeros((count, len(names)), "<f4")
    table[:, 0:3] = gaussians.means
    table[:, 6:9] = gaussians.sh[:, 0]
    table[:, 9 : 9 + 3 * rest] = gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(count, -1)
    table[:, 9 + 3 * rest] = gaussians.opacity_logits
    table[:, 10 + 3 * rest : 13 + 3 * rest] = gaussians.log_scales
    table[:, 13 + 3 * rest :] = gaussians.quats
    return "\n".join(header).encode() + table.tobytes()


def _rest_names(vertex: Element, subject: object) -> tuple[str, ...]:
    count = sum(name.startswith("f_rest_") for name in vertex.names)
    names = tuple(f"f_rest_{i}" for i in range(count))
    if count not in [3 * n for n in REST_COUNTS.values()] or not set(names) <= set(vertex.names):
        expected = "f_rest_0 to f_rest_(n-1) with n of 0, 9, 24 or 45"
        raise InputError(subject, field="f_rest", expected=expected, found=f"{count} such properties")
    return names


class _Columns:
    """Named columns as float32 blocks; one slice of a plain float matrix where the file is laid out so."""

    def __init__(self, rows: dict[str, np.ndarray] | np.ndarray, vertex: Element) -> None:
        self._rows, self._names = rows, vertex.names
        plain = isinstance(rows, np.ndarray) and all(kind == "f4" for _, kind in vertex.properties)
        self._matrix: np.ndarray | None = None
        if plain and isinstance(rows, np.ndarray):
            self._matrix = rows.view(rows.dtype[0]).reshape(vertex.count, len(vertex.names))

    def take(self, names: tuple[str, ...]) -> Float32[np.ndarray, "M n"]:
        if self._matrix is not None:
            ids = [self._names.index(name) for name in names]
            run = ids == list(range(ids[0], ids[0] + len(ids)))
            return (self._matrix[:, ids[0] : ids[0] + len(ids)] if run else self._matrix[:, ids]).astype(np.float32)
        return np.stack([self._rows[name].astype(np.float32) for name in names], axis=1)


def _shortened(names: tuple[str, ...]) -> str:
    return ", ".join(names[:12]) + (f", and {len(names) - 12} more" if len(names) > 12 else "") if names else "none"
