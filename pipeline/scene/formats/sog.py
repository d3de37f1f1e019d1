"""SOG (PlayCanvas): attributes as lossless WebP images described by meta.json, zipped as .sog or beside it."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, UInt8

from pipeline.scene.formats.raw import REST_COUNTS, RawGaussians, logits_of_bytes
from pipeline.scene.formats.smallest_three import SQRT_HALF, quats_from_three
from schemas.errors import InputError

ZIP = b"PK\x03\x04"
META = "meta.json"
DAMAGED_ZIP = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    ValueError,
    RuntimeError,
    NotImplementedError,
    EOFError,
)
"""What zipfile raises for a damaged archive; RuntimeError stands for an encrypted member."""

MAX_MEMBER_BYTES = 1 << 31
"""A member that claims more is refused before it is unpacked."""

CENTROIDS_A_ROW = 64
"""Entries of the spherical-harmonics palette in one row of its image."""

QUAT_TAG = 252
"""Alpha of a rotation pixel: 252 + place of the largest component."""


def read_sog(data: bytes, subject: object) -> RawGaussians:
    """Return the Gaussians of a .sog bundle, version 1 or 2.

    Raises:
        InputError: The archive, meta.json or an image is damaged, missing or inconsistent.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except DAMAGED_ZIP as error:
        raise InputError(subject, expected="a zip archive", found=error) from error

    members = {info.filename: info for info in archive.infolist()}

    def load(name: str) -> bytes:
        if name not in members:
            raise InputError(subject, field=name, expected="a file in the archive", found="none")
        if (size := members[name].file_size) > MAX_MEMBER_BYTES:
            raise InputError(subject, field=name, expected=f"at most {MAX_MEMBER_BYTES} bytes", found=size)
        try:
            return archive.read(members[name])
        except DAMAGED_ZIP as error:
            raise InputError(subject, field=name, expected="an undamaged file in the archive", found=error) from error

    return read_sog_parts(load, subject)


def read_sog_parts(load: Callable[[str], bytes], subject: object) -> RawGaussians:
    """Return the Gaussians of SOG files given one by one.

    Args:
        load: Gives the bytes of a file by its name; "meta.json" is asked for first.
        subject: Archive or folder, for messages.

    Raises:
        InputError: As for `read_sog`.
    """
    meta = _Meta(load, subject)
    count = meta.count
    low, high = (meta.pixels("means", i, count)[:, :3].astype(np.uint16) for i in (0, 1))
    fraction = (low | (high << 8)).astype(np.float32) / 65535
    mins, maxs = meta.numbers("means", "mins", 3), meta.numbers("means", "maxs", 3)
    log_means = mins + (maxs - mins) * fraction
    means = (np.sign(log_means) * np.expm1(np.abs(log_means))).astype(np.float32)
    tags = meta.pixels("quats", 0, count)
    places = tags[:, 3].astype(np.int64) - QUAT_TAG
    if (places < 0).any():
        raise InputError(subject, field="quats", expected="alpha of 252 to 255", found=int(tags[:, 3].min()))
    others = (tags[:, :3].astype(np.float32) / 255 * 2 - 1) * np.float32(SQRT_HALF)
    colors = meta.pixels("sh0", 0, count)
    dc, logits = meta.colors(colors)
    rest = meta.rest(count)
    return RawGaussians(
        means,
        quats_from_three(places, others),
        meta.values("scales", meta.pixels("scales", 0, count)[:, :3]),
        logits,
        np.concatenate([dc[:, None], rest], axis=1).astype(np.float32),
    )


class _Meta:
    """meta.json with checked access: version 1 has linear bounds per channel, version 2 has codebooks."""

    def __init__(self, load: Callable[[str], bytes], subject: object) -> None:
        self._load, self._subject = load, subject
        try:
            meta = json.loads(load(META))
        except (ValueError, RecursionError) as error:
            raise InputError(subject, field=META, expected="JSON", found=error) from error
        if not isinstance(meta, dict) or meta.get("version") not in (None, 1, 2):
            found = meta.get("version") if isinstance(meta, dict) else type(meta).__name__
            raise InputError(subject, field="version", expected="SOG version 1 or 2", found=found)
        self._meta: dict[str, Any] = meta
        self.linear = meta.get("version") != 2
        shape = self._entry("means").get("shape")
        count = (shape[0] if isinstance(shape, list) and shape else None) if self.linear else meta.get("count")
        if not isinstance(count, int) or isinstance(count, bool) or not 0 <= count < 1 << 31:
            raise InputError(subject, field="count", expected="a number of Gaussians", found=count)
        self.count: int = count

    def _entry(self, name: str) -> dict[str, Any]:
        entry = self._meta.get(name)
        if not isinstance(entry, dict):
            raise InputError(self._subject, field=f"{META} {name}", expected="an object", found=type(entry).__name__)
        return entry

    def numbers(self, name: str, key: str, size: int | None) -> Float32[np.ndarray, "n"]:
        """Return a list of numbers; `size` None takes any length, and a single number counts as a list."""
        value = self._entry(name).get(key)
        try:
            numbers = np.atleast_1d(np.array(value, np.float64))
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if numbers.ndim != 1 or not len(numbers) or (size is not None and len(numbers) != size):
            expected = f"{size} numbers" if size else "a list of numbers"
            raise InputError(self._subject, field=f"{META} {name}.{key}", expected=expected, found=str(value)[:80])
        return numbers.astype(np.float32)

    def image(self, name: str, index: int) -> UInt8[np.ndarray, "h w 4"]:
        """Return an image as RGBA."""
        files = self._entry(name).get("files")
        file = files[index] if isinstance(files, list) and len(files) > index else None
        if not isinstance(file, str) or not _is_plain_name(file):
            expected = "names of images beside meta.json"
            raise InputError(self._subject, field=f"{META} {name}.files", expected=expected, found=files)
        return _decoded(self._load(file), self._subject, file)

    def pixels(self, name: str, index: int, count: int) -> UInt8[np.ndarray, "M 4"]:
        """Return the first `count` pixels of an image."""
        pixels = self.image(name, index).reshape(-1, 4)
        if len(pixels) < count:
            raise InputError(self._subject, field=name, expected=f"at least {count} pixels", found=len(pixels))
        return pixels[:count]

    def values(self, name: str, codes: UInt8[np.ndarray, "M c"]) -> Float32[np.ndarray, "M c"]:
        """Return the numbers that codes stand for: bounds per channel in version 1, a codebook in version 2."""
        if self.linear:
            channels = codes.shape[1]
            mins = self.numbers(name, "mins", None)[:channels]
            maxs = self.numbers(name, "maxs", None)[:channels]
            if not {len(mins), len(maxs)} <= {1, channels}:
                raise InputError(self._subject, field=name, expected=f"bounds of {channels} channels", found=len(mins))
            return (mins + (maxs - mins) * (codes.astype(np.float32) / 255)).astype(np.float32)
        codebook = self.numbers(name, "codebook", None)
        if codes.size and int(codes.max()) >= len(codebook):
            found = f"{len(codebook)} for code {int(codes.max())}"
            raise InputError(self._subject, field=f"{META} {name}.codebook", expected="an entry a code", found=found)
        return codebook[codes]

    def colors(self, pixels: UInt8[np.ndarray, "M 4"]) -> tuple[Float32[np.ndarray, "M 3"], Float32[np.ndarray, "M"]]:
        """Return constant coefficients and opacity logits: version 1 stores logits, version 2 opacities."""
        if self.linear:
            values = self.values("sh0", pixels)
            return values[:, :3], values[:, 3].copy()
        return self.values("sh0", pixels[:, :3]), logits_of_bytes(pixels[:, 3])

    def rest(self, count: int) -> Float[np.ndarray, "M K 3"]:
        """Return the higher coefficients, looked up in a palette; none where the file has none."""
        if "shN" not in self._meta:
            return np.zeros((count, 0, 3), np.float32)
        palette = self.image("shN", 0)
        per_channel = palette.shape[1] // CENTROIDS_A_ROW
        if per_channel not in list(REST_COUNTS.values())[1:] or palette.shape[1] % CENTROIDS_A_ROW:
            expected = "a palette 192, 512 or 960 pixels wide"
            raise InputError(self._subject, field="shN", expected=expected, found=palette.shape[1])
        entries = palette[..., :3].reshape(-1, per_channel, 3)
        pixels = self.pixels("shN", 1, count).astype(np.int64)
        labels = pixels[:, 0] | (pixels[:, 1] << 8)
        if count and int(labels.max()) >= len(entries):
            expected = f"labels under {len(entries)}"
            raise InputError(self._subject, field="shN", expected=expected, found=int(labels.max()))
        values = self.values("shN", entries.reshape(-1, 3)).reshape(entries.shape)
        return values[labels]


def _is_plain_name(name: str) -> bool:
    """Return whether a name stays in the folder: meta.json may come from anywhere."""
    return bool(name) and not set(name) & set("/\\:") and name != ".."


def _is_lossy(data: bytes) -> bool:
    """Return whether a WebP file holds a lossy (VP8) image; its pixels would be near the stored numbers, not them."""
    at = 12
    while data[:4] == b"RIFF" and at + 8 <= len(data):
        if data[at : at + 4] == b"VP8 ":
            return True
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        at += 8 + size + size % 2
    return False


def _decoded(data: bytes, subject: object, name: str) -> UInt8[np.ndarray, "h w 4"]:
    from PIL import Image

    if _is_lossy(data):
        raise InputError(subject, field=name, expected="lossless WebP", found="lossy WebP")
    bombs = (Image.DecompressionBombError, Image.DecompressionBombWarning)
    try:
        with Image.open(io.BytesIO(data), formats=["WEBP", "PNG"]) as image:
            return np.asarray(image.convert("RGBA"))
    except (OSError, ValueError, SyntaxError, EOFError, MemoryError, *bombs) as error:
        raise InputError(subject, field=name, expected="a WebP image", found=error) from error
