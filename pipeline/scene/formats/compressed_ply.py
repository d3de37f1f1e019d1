"""Compressed PLY (PlayCanvas, SuperSplat): chunks of 256 Gaussians quantised between the bounds of their chunk."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Integer, UInt32

from pipeline.scene.formats.ply_header import Header, read_element
from pipeline.scene.formats.raw import REST_COUNTS, SH_C0, RawGaussians, logits_of_bytes
from pipeline.scene.formats.smallest_three import SQRT_HALF, quats_from_three
from schemas.errors import InputError

CHUNK = 256
"""Gaussians that share bounds."""

POINT_BITS = ((21, 11), (11, 10), (0, 11))
"""Shift and width of x, y and z in a packed position or scale."""

SH_VALUES = (8 * ((np.arange(256) + 0.5) / 256 - 0.5)).astype(np.float32)
"""Coefficients are stored in 256 steps over -4..4; the middle of each step."""

PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")


def is_compressed(header: Header) -> bool:
    """Return whether a PLY header is that of a compressed file."""
    vertex = header.element("vertex")
    return vertex is not None and "packed_position" in vertex.names


def read_compressed_ply(data: bytes, header: Header, subject: object) -> RawGaussians:
    """Return the Gaussians of a compressed PLY.

    Raises:
        InputError: Bounds or packed values are missing or of another type, or there are too few chunks or rows.
    """
    chunk, vertex = header.element("chunk"), header.element("vertex")
    if header.encoding == "ascii" or vertex is None or chunk is None:
        raise InputError(subject, field="header", expected="binary elements chunk and vertex", found="another layout")
    for name in PACKED:
        if (name, "u4") not in vertex.properties:
            raise InputError(subject, field=name, expected="a uint of each vertex", found=vertex.names)
    if chunk.count * CHUNK < vertex.count:
        expected = f"{-(-vertex.count // CHUNK)} chunks for {vertex.count} vertices"
        raise InputError(subject, field="chunk", expected=expected, found=chunk.count)
    bounds, rows = read_element(data, header, "chunk", subject), read_element(data, header, "vertex", subject)
    owner = np.arange(vertex.count) // CHUNK

    def unpacked(prefix: str, axes: str, parts: Float32[np.ndarray, "M 3"]) -> Float32[np.ndarray, "M 3"]:
        low = _bounds(bounds, [f"min_{prefix}{axis}" for axis in axes], subject)[owner]
        high = _bounds(bounds, [f"max_{prefix}{axis}" for axis in axes], subject)[owner]
        return low + (high - low) * parts

    packed_color = rows["packed_color"].astype(np.uint32)
    fraction = _fields(packed_color, ((24, 8), (16, 8), (8, 8)))
    # Files written before colours had bounds hold them in 0..1.
    rgb = unpacked("", "rgb", fraction) if "min_r" in chunk.names else fraction
    rest = _rest(data, header, vertex.count, subject)
    sh = np.empty((vertex.count, 1 + rest.shape[1], 3), np.float32)
    sh[:, 0] = (rgb - np.float32(0.5)) / np.float32(SH_C0)
    sh[:, 1:] = rest
    return RawGaussians(
        unpacked("", "xyz", _fields(rows["packed_position"], POINT_BITS)),
        _quats(rows["packed_rotation"].astype(np.uint32)),
        unpacked("scale_", "xyz", _fields(rows["packed_scale"], POINT_BITS)),
        logits_of_bytes((packed_color & 0xFF).astype(np.uint8)),
        sh,
    )


def _bounds(rows: dict[str, np.ndarray] | np.ndarray, names: list[str], subject: object) -> Float32[np.ndarray, "C 3"]:
    present = rows.dtype.names or () if isinstance(rows, np.ndarray) else tuple(rows)
    for name in names:
        if name not in present:
            raise InputError(subject, field=name, expected="a property of each chunk", found=", ".join(present))
    return np.stack([rows[name].astype(np.float32) for name in names], axis=1)


def _fields(packed: Integer[np.ndarray, "M"], bits: tuple[tuple[int, int], ...]) -> Float32[np.ndarray, "M n"]:
    """Return bit fields (shift, width) as fractions of their largest value, 0 to 1."""
    columns = [((packed >> shift) & ((1 << width) - 1)).astype(np.float32) for shift, width in bits]
    return np.stack(columns, axis=1) / np.array([(1 << width) - 1 for _, width in bits], np.float32)


def _quats(packed: UInt32[np.ndarray, "M"]) -> Float32[np.ndarray, "M 4"]:
    # Three components in -sqrt(1/2)..sqrt(1/2), in the order wxyz without the largest.
    others = (_fields(packed, ((20, 10), (10, 10), (0, 10))) - 0.5) * np.float32(2 * SQRT_HALF)
    return quats_from_three((packed >> 30).astype(np.int64), others)


def _rest(data: bytes, header: Header, count: int, subject: object) -> Float32[np.ndarray, "M K 3"]:
    element = header.element("sh")
    if element is None:
        return np.zeros((count, 0, 3), np.float32)
    per_channel = len(element.properties) // 3
    names = tuple((f"f_rest_{i}", "u1") for i in range(3 * per_channel))
    if element.properties != names or per_channel not in REST_COUNTS.values() or element.count != count:
        expected = f"{count} rows of f_rest_0 to f_rest_(n-1), uchar, with n of 9, 24 or 45"
        found = f"{element.count} rows of {len(element.properties)} properties"
        raise InputError(subject, field="sh", expected=expected, found=found)
    rows = read_element(data, header, "sh", subject)
    assert isinstance(rows, np.ndarray)
    codes = rows.view(np.uint8).reshape(count, 3, per_channel)
    return SH_VALUES[codes].transpose(0, 2, 1)
