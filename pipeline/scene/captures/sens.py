"""ScanNet `.sens` files, version 4: colour and depth of a whole scan in one file, read a frame at a time.

Little-endian. Head: version u32; sensor name (length u64, bytes); colour intrinsics, colour extrinsics, depth
intrinsics, depth extrinsics, each 4x4 float32 by rows; colour and depth compression i32; colour width and height,
depth width and height u32; depth steps a metre float32; number of frames u64. Each frame: camera-to-world 4x4
float32 in OpenCV axes; time of colour and of depth u64; bytes of colour and of depth u64; those bytes. Motion
records may follow and are not read.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float, Float32, UInt8

from pipeline.geometry import invert_rigid, nearest_rigid, validate_pose
from pipeline.scene.captures.capture import Capture, Frame, Skipped
from pipeline.scene.captures.image_files import decode_image, depth_in_metres
from pipeline.scene.captures.views_file import camera_of
from schemas.errors import InputError
from schemas.storage import local_path

VERSION = 4
COLOR_CODES = {1: "png", 2: "jpeg"}
"""Colour compressions that are read; 0 is raw, which no release uses."""
DEPTH_CODES = {0: "raw", 1: "zlib"}
"""Depth compressions that are read; 2 is a codec of one vendor."""
OPENEQA_FRAMES = 600
"""OpenEQA's episodes are the first this many frames of a scan."""
_FRAME_HEAD = struct.Struct("<16f4Q")


@dataclass(frozen=True, slots=True)
class SensImage:
    """A photograph inside a .sens file."""

    path: str
    """The file."""
    offset: int
    """First byte."""
    size: int
    """Bytes."""

    def read(self) -> UInt8[np.ndarray, "H W 3"]:
        """Return sRGB pixels.

        Raises:
            InputError: The bytes are no image.
        """
        return decode_image(_slice(self.path, self.offset, self.size), f"{self.path} byte {self.offset}")


@dataclass(frozen=True, slots=True)
class SensDepth:
    """A depth image inside a .sens file."""

    path: str
    """The file."""
    offset: int
    """First byte."""
    size: int
    """Bytes."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    unit_m: float
    """Metres of one step."""
    compressed: bool = True
    """Whether the bytes are deflated."""

    def read(self) -> Float32[np.ndarray, "h w"]:
        """Return z-depth in metres, 0 where there is none.

        Raises:
            InputError: The bytes do not unpack to the image's size.
        """
        subject, data = f"{self.path} byte {self.offset}", _slice(self.path, self.offset, self.size)
        expected = 2 * self.width * self.height
        if self.compressed:
            try:
                data = zlib.decompressobj().decompress(data, expected + 1)
            except zlib.error as error:
                raise InputError(subject, field="depth", expected="deflated bytes", found=error) from error
        if len(data) != expected:
            raise InputError(subject, field="depth", expected=f"{expected} bytes", found=f"{len(data)} or more")
        return depth_in_metres(np.frombuffer(data, "<u2").reshape(self.height, self.width), self.unit_m)


@dataclass(frozen=True, slots=True)
class _Head:
    color_K: Float[np.ndarray, "3 3"]
    depth_K: Float[np.ndarray, "3 3"]
    still: bool
    depth_code: int
    color_size: tuple[int, int]
    depth_size: tuple[int, int]
    unit_m: float
    frames: int


def read_sens(uri: str | Path, *, limit: int | None = None, name: str = "") -> Capture:
    """Return the capture of a .sens file; only its head and the heads of its frames are read here.

    Args:
        uri: Local path; frames are read from it later, so it must stay.
        limit: First frames to take; None takes all. `OPENEQA_FRAMES` gives OpenEQA's episode.
        name: Scene name; empty takes the file's.

    Raises:
        InputError: It is not local, not of version 4, cut short, of an unknown compression, or no pose is usable.
    """
    path = local_path(uri)
    if path is None or not path.is_file():
        raise InputError(uri, expected="a local .sens file", found="nothing there" if path else "a URI")
    frames: list[Frame] = []
    skipped: list[Skipped] = []
    with path.open("rb") as stream:
        head = _read_head(stream, path)
        count = head.frames if limit is None else min(limit, head.frames)
        for index, (matrix, color_at, depth_at) in enumerate(_frame_heads(stream, path, count, head.frames)):
            frame_name = f"{index:06d}"
            subject = f"{path} frame {index}"
            try:
                pose = invert_rigid(nearest_rigid(validate_pose(matrix, subject)))
            except InputError as error:
                skipped.append(Skipped(frame_name, "broken pose", str(error)))
                continue
            depth = SensDepth(str(path), *depth_at, *head.depth_size, head.unit_m, head.depth_code == 1)
            frames.append(
                Frame(
                    name=frame_name,
                    camera=camera_of(head.color_K, pose, *head.color_size, subject),
                    image=SensImage(str(path), *color_at) if color_at[1] else None,
                    depth=depth if depth_at[1] else None,
                    depth_camera=camera_of(head.depth_K, pose, *head.depth_size, subject),
                )
            )
    notes = () if head.still else (f"{path}: extrinsics are not the identity; poses are taken as they are",)
    return Capture(name or path.stem, tuple(frames), tuple(skipped), notes, np.array([0.0, 0.0, 1.0]))


def _read_head(stream: BinaryIO, path: Path) -> _Head:
    def unpack(form: str) -> tuple[Any, ...]:
        size = struct.calcsize("<" + form)
        data = stream.read(size)
        if len(data) < size:
            raise InputError(path, expected=f"{size} more bytes of the head", found=len(data))
        return struct.unpack("<" + form, data)

    version = unpack("I")[0]
    if version != VERSION:
        raise InputError(path, field="version", expected=str(VERSION), found=version)
    length = unpack("Q")[0]
    if length > 4096:
        raise InputError(path, field="sensor name", expected="a short text", found=f"{length} bytes")
    stream.seek(length, os.SEEK_CUR)
    color_K, color_at, depth_K, depth_at = (np.array(unpack("16f"), np.float64).reshape(4, 4) for _ in range(4))
    color_code, depth_code = unpack("2i")
    for field, code, known in (("colour", color_code, COLOR_CODES), ("depth", depth_code, DEPTH_CODES)):
        if code not in known:
            expected = ", ".join(f"{number} ({word})" for number, word in known.items())
            raise InputError(path, field=f"{field} compression", expected=expected, found=code)
    color_width, color_height, depth_width, depth_height = unpack("4I")
    steps_a_metre = unpack("f")[0]
    if not steps_a_metre > 0:
        raise InputError(path, field="depth shift", expected="steps a metre, above 0", found=steps_a_metre)
    still = all(np.allclose(matrix, np.eye(4), atol=1e-4) for matrix in (color_at, depth_at))
    return _Head(
        color_K=color_K[:3, :3],
        depth_K=depth_K[:3, :3],
        still=still,
        depth_code=depth_code,
        color_size=(color_width, color_height),
        depth_size=(depth_width, depth_height),
        unit_m=1.0 / steps_a_metre,
        frames=unpack("Q")[0],
    )


def _frame_heads(
    stream: BinaryIO, path: Path, count: int, total: int
) -> Iterator[tuple[Float[np.ndarray, "4 4"], tuple[int, int], tuple[int, int]]]:
    """Yield pose, and offset and size of colour and depth, without reading either."""
    end = path.stat().st_size
    for index in range(count):
        data = stream.read(_FRAME_HEAD.size)
        *values, _, _, color_size, depth_size = _FRAME_HEAD.unpack(data) if len(data) == _FRAME_HEAD.size else (0,) * 20
        at = stream.tell()
        if len(data) < _FRAME_HEAD.size or at + color_size + depth_size > end:
            raise InputError(path, expected=f"{total} frames", found=f"{index}, then the file ends: fetch it again")
        yield np.array(values, np.float64).reshape(4, 4), (at, color_size), (at + color_size, depth_size)
        stream.seek(color_size + depth_size, os.SEEK_CUR)


def _slice(path: str, offset: int, size: int) -> bytes:
    try:
        with open(path, "rb") as stream:
            stream.seek(offset)
            data = stream.read(size)
    except OSError as error:
        raise InputError(path, expected="a file that can be read", found=error.strerror or error) from error
    if len(data) < size:
        raise InputError(path, expected=f"{size} bytes at byte {offset}", found=len(data))
    return data
