"""Niantic SPZ, versions 1 to 4: one byte stream an attribute, gzipped as one (1-3) or Zstandard one by one (4).

SPZ stores right-up-back axes where PLY has right-down-forward, so y and z change sign at this door, and with them
the matching quaternion and spherical-harmonics components. The same object saved as PLY and as SPZ reads the same.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from pipeline.scene.formats.raw import REST_COUNTS, RawGaussians, logits_of_bytes
from pipeline.scene.formats.smallest_three import SQRT_HALF, quats_from_three
from schemas.compression import unzstd
from schemas.errors import InputError

MAGIC = b"NGSP"
GZIP = b"\x1f\x8b"
COLOR_SCALE = 0.15
"""Colours are stored as 0.5 + 0.15 x the constant coefficient, so that overbright ones fit."""

MAX_DEGREE = 4
"""Degree 4 exists in the format; renderers here stop at 3, so its last band is left out with a warning."""

ALL_REST_COUNTS = {**REST_COUNTS, 4: 24}

ANTIALIASED = 0x1
"""Flag: trained with the low-pass filter's loss of opacity made up for."""

HAS_EXTENSIONS = 0x2
"""Flag: records of other tools follow the attributes (up to version 3) or the header (4); they are passed over."""

MAX_EXTENSION_BYTES = 1 << 20
"""Extensions hold a few numbers, such as a camera path's bounds."""

AXES = np.array([1, -1, -1], np.float32)
"""Right-up-back to right-down-forward: half a turn about x."""

SH_SIGNS = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)
"""Sign of each coefficient of degrees 1 to 3 under that half turn: minus where y and z come an odd number of times."""


@dataclass(frozen=True, slots=True)
class _Header:
    version: int
    count: int
    degree: int
    fraction_bits: int
    flags: int
    streams: int
    table_start: int

    @property
    def extended(self) -> bool:
        """Whether records of other tools are present."""
        return bool(self.flags & HAS_EXTENSIONS)

    @property
    def end(self) -> int:
        """Bytes up to the end of the attributes, unpacked, up to version 3."""
        return 16 + sum(self.sizes.values())

    @property
    def sizes(self) -> dict[str, int]:
        """Bytes of each attribute, in file order."""
        rotation = 4 if self.version >= 3 else 3
        center = 6 if self.version == 1 else 9
        widths = {"positions": center, "alphas": 1, "colors": 3, "scales": 3, "rotations": rotation}
        return {k: w * self.count for k, w in {**widths, "sh": 3 * ALL_REST_COUNTS[self.degree]}.items()}


def read_spz(data: bytes, subject: object) -> RawGaussians:
    """Return the Gaussians of an SPZ file: gzipped, bare (the same bytes without gzip) or version 4.

    Raises:
        InputError: The version or degree is unknown, or bytes are missing, corrupt or too many.
    """
    if data[:2] == GZIP:
        header = _header(_gunzip(data, 16, subject), subject)
        data = _gunzip(data, header.end + (MAX_EXTENSION_BYTES if header.extended else 0), subject)
        header = _header(data, subject)
    else:
        header = _header(data, subject)
    if header.version >= 4:
        parts = _streams(data, header, subject)
    else:
        if len(data) < header.end or (len(data) > header.end and not header.extended):
            expected = f"{header.end} bytes for {header.count} Gaussians"
            raise InputError(subject, expected=expected, found=f"{len(data)} bytes")
        parts = _split(data[16:], header)
    return _decode({name: np.frombuffer(part, np.uint8) for name, part in parts.items()}, header)


def _header(data: bytes, subject: object) -> _Header:
    if len(data) < 16 or data[:4] != MAGIC:
        raise InputError(subject, expected="an SPZ header starting NGSP", found=repr(data[:4]))
    version, count, degree, bits, flags, streams = struct.unpack_from("<IIBBBB", data, 4)
    if version not in (1, 2, 3, 4):
        raise InputError(subject, field="version", expected="SPZ version 1 to 4", found=version)
    if degree > MAX_DEGREE:
        raise InputError(subject, field="sh_degree", expected="0 to 4", found=degree)
    if bits > 24:
        raise InputError(subject, field="fractional_bits", expected="0 to 24", found=bits)
    if version < 4:
        return _Header(version, count, degree, bits, flags, 0, 16)
    if len(data) < 32:
        raise InputError(subject, expected="a header of 32 bytes", found=len(data))
    return _Header(version, count, degree, bits, flags, streams, struct.unpack_from("<I", data, 16)[0])


def _gunzip(data: bytes, size: int, subject: object) -> bytes:
    """Return the stream's bytes: all of them, checksum verified, where there are at most `size`; else `size` + 1."""
    stream = zlib.decompressobj(wbits=31)
    try:
        # The bound keeps a stream that unpacks to more than its header says from filling the memory.
        out = stream.decompress(data, size + 1)
    except zlib.error as error:
        raise InputError(subject, expected="an undamaged gzip stream", found=error) from error
    if len(out) <= size and not stream.eof:
        raise InputError(subject, expected="a whole gzip stream", found=f"its end missing after {len(out)} bytes")
    return out


def _split(payload: bytes, header: _Header) -> dict[str, bytes]:
    parts, start = {}, 0
    for name, size in header.sizes.items():
        parts[name] = payload[start : start + size]
        start += size
    return parts


def _streams(data: bytes, header: _Header, subject: object) -> dict[str, bytes]:
    sizes = {name: size for name, size in header.sizes.items() if size}
    table_end = header.table_start + 16 * header.streams
    if header.streams < len(sizes) or header.table_start < 32 or table_end > len(data):
        found = f"{header.streams} streams listed at byte {header.table_start} of {len(data)}"
        raise InputError(subject, field="streams", expected=f"a table of at least {len(sizes)} streams", found=found)
    parts, start = dict.fromkeys(header.sizes, b""), table_end
    for i, (name, size) in enumerate(sizes.items()):
        packed, unpacked = struct.unpack_from("<QQ", data, header.table_start + 16 * i)
        if unpacked != size or start + packed > len(data):
            found = f"{unpacked} bytes from {packed} of {len(data) - start}"
            raise InputError(subject, field=name, expected=f"a stream of {size} bytes", found=found)
        parts[name] = unzstd(data[start : start + packed], size, subject, name)
        start += packed
    return parts


def _decode(parts: dict[str, UInt8[np.ndarray, "_"]], header: _Header) -> RawGaussians:
    count, rest = header.count, ALL_REST_COUNTS[header.degree]
    kept = min(rest, REST_COUNTS[3])
    warnings = ["spherical harmonics of degree 4: the last band is left out"] if rest > kept else []
    if header.flags & ANTIALIASED:
        warnings.append("trained with antialiasing: it looks as trained only when rendered with `antialias`")
    sh = np.empty((count, 1 + kept, 3), np.float32)
    sh[:, 0] = (parts["colors"].reshape(count, 3).astype(np.float32) / 255 - np.float32(0.5)) / np.float32(COLOR_SCALE)
    stored = parts["sh"].reshape(count, rest, 3)[:, :kept].astype(np.float32)
    sh[:, 1:] = (stored - 128) / 128 * SH_SIGNS[:kept, None]
    return RawGaussians(
        _positions(parts["positions"], header) * AXES,
        _rotations(parts["rotations"], header) * np.concatenate([[1], AXES]).astype(np.float32),
        parts["scales"].reshape(count, 3).astype(np.float32) / 16 - 10,
        logits_of_bytes(parts["alphas"]),
        sh,
        warnings=tuple(warnings),
    )


def _positions(part: UInt8[np.ndarray, "_"], header: _Header) -> Float32[np.ndarray, "M 3"]:
    if header.version == 1:
        return part.view("<f2").reshape(-1, 3).astype(np.float32)
    low, middle, high = np.moveaxis(part.reshape(-1, 3, 3).astype(np.int32), -1, 0)
    value = low | (middle << 8) | (high << 16)
    # Shifting the 24-bit value to the top of an int32 and back extends its sign.
    return ((value << 8) >> 8).astype(np.float32) / np.float32(1 << header.fraction_bits)


def _rotations(part: UInt8[np.ndarray, "_"], header: _Header) -> Float32[np.ndarray, "M 4"]:
    if header.version < 3:
        xyz = part.reshape(-1, 3).astype(np.float32) / np.float32(127.5) - 1
        return quats_from_three(np.zeros(len(xyz), np.int64), xyz)
    packed = part.view("<u4")
    fields = np.stack([packed >> 20, packed >> 10, packed], axis=1) & 0x3FF
    size = (fields & 0x1FF).astype(np.float32) / 511 * np.float32(SQRT_HALF)
    xyzw = quats_from_three((packed >> 30).astype(np.int64), np.where(fields & 0x200, -size, size))
    return np.roll(xyzw, 1, axis=1)
