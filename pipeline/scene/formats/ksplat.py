"""`.ksplat` (GaussianSplats3D): sections of Gaussians, plain or quantised to 16 bits within buckets."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64, Shaped

from pipeline.scene.formats.raw import REST_COUNTS, SH_C0, RawGaussians, array_at, logits_of_bytes
from schemas.errors import InputError

HEADER_BYTES = 4096
SECTION_BYTES = 1024

HEADER_FIELDS = {
    "major": (0, "u1"),
    "minor": (1, "u1"),
    "sections": (4, "<u4"),
    "level": (20, "<u2"),
    "sh_low": (36, "<f4"),
    "sh_high": (40, "<f4"),
}
"""Offset and type of what is read of the file header."""

SECTION_FIELDS = {
    "count": (0, "<u4"),
    "capacity": (4, "<u4"),
    "bucket_size": (8, "<u4"),
    "buckets": (12, "<u4"),
    "block": (16, "<f4"),
    "bucket_bytes": (20, "<u2"),
    "range": (24, "<u4"),
    "full": (32, "<u4"),
    "partial": (36, "<u4"),
    "degree": (40, "<u2"),
}
"""Offset and type of what is read of a section header; `capacity` rows lie on disk, `count` of them are filled."""

SH_DEFAULT = 1.5
"""Bound of 8-bit coefficients in files that give none."""

DEFAULT_RANGE = {0: 1, 1: 32767, 2: 32767}
"""Steps from a bucket's centre to its edge, by compression level."""


def _packed(fields: dict[str, tuple[int, str]], size: int) -> np.dtype[np.void]:
    offsets, formats = zip(*fields.values(), strict=True)
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": size})


HEADER = _packed(HEADER_FIELDS, HEADER_BYTES)
SECTION = _packed(SECTION_FIELDS, SECTION_BYTES)


def read_ksplat(data: bytes, subject: object) -> RawGaussians:
    """Return the Gaussians of a .ksplat file of version 0.1, at any of its three compression levels.

    Raises:
        InputError: The version or level is unknown, sections disagree in degree, or bytes are missing.
    """
    if len(data) < HEADER_BYTES:
        raise InputError(subject, expected=f"a header of {HEADER_BYTES} bytes", found=f"{len(data)} bytes")
    header = np.frombuffer(data, HEADER, 1)[0]
    if (version := (int(header["major"]), int(header["minor"]))) != (0, 1):
        raise InputError(subject, field="version", expected="0.1", found=f"{version[0]}.{version[1]}")
    level, sections = int(header["level"]), int(header["sections"])
    if level not in DEFAULT_RANGE:
        raise InputError(subject, field="compression level", expected="0, 1 or 2", found=level)
    start = HEADER_BYTES + sections * SECTION_BYTES
    if start > len(data):
        found = f"{(len(data) - HEADER_BYTES) // SECTION_BYTES} in {len(data)} bytes"
        raise InputError(subject, field="sections", expected=f"{sections} section headers", found=found)
    bounds = (float(header["sh_low"]) or -SH_DEFAULT, float(header["sh_high"]) or SH_DEFAULT)
    parts = []
    for section in array_at(data, SECTION, sections, HEADER_BYTES):
        part, start = _read_section(data, start, section, level, bounds, subject)
        parts.append(part)
    if len({part.sh.shape[1] for part in parts}) > 1:
        raise InputError(subject, field="sh degree", expected="one degree in every section", found="several")
    if not parts:
        raise InputError(subject, field="sections", expected="at least one", found=0)
    return RawGaussians(
        np.concatenate([part.means for part in parts]),
        np.concatenate([part.quats for part in parts]),
        np.concatenate([part.log_scales for part in parts]),
        np.concatenate([part.opacity_logits for part in parts]),
        np.concatenate([part.sh for part in parts]),
    )


def _read_section(
    data: bytes, start: int, section: np.void, level: int, bounds: tuple[float, float], subject: object
) -> tuple[RawGaussians, int]:
    """Return a section's Gaussians and where the next section starts."""
    count, capacity, degree = int(section["count"]), int(section["capacity"]), int(section["degree"])
    if degree not in (0, 1, 2):
        raise InputError(subject, field="sh degree", expected="0 to 2", found=degree)
    row = _row(level, REST_COUNTS[degree] * 3)
    partial, buckets, bucket_bytes = int(section["partial"]), int(section["buckets"]), int(section["bucket_bytes"])
    rows_at = start + 4 * partial + buckets * bucket_bytes
    end = rows_at + capacity * row.itemsize
    if count > capacity or rows_at + count * row.itemsize > len(data):
        expected, found = f"{count} Gaussians of {row.itemsize} bytes", f"room for {capacity} in {len(data)} bytes"
        raise InputError(subject, field="section", expected=expected, found=found)
    rows = array_at(data, row, count, rows_at)
    means = rows["mean"].astype(np.float32)
    if level:
        if bucket_bytes != 12:
            raise InputError(subject, field="bucket size", expected="12 bytes", found=bucket_bytes)
        lengths = array_at(data, "<u4", partial, start).astype(np.int64)
        owner = _owners(count, int(section["full"]), int(section["bucket_size"]), lengths, buckets, subject)
        centers = array_at(data, "<f4", 3 * buckets, start + 4 * partial).reshape(-1, 3)
        steps = int(section["range"]) or DEFAULT_RANGE[level]
        means = ((means - steps) * np.float32(float(section["block"]) / 2 / steps) + centers[owner]).astype(np.float32)
    log_scales = np.log(rows["scale"].astype(np.float32))
    sh = np.empty((count, 1 + REST_COUNTS[degree], 3), np.float32)
    sh[:, 0] = (rows["rgba"][:, :3].astype(np.float32) / 255 - np.float32(0.5)) / np.float32(SH_C0)
    if degree:
        sh[:, 1:] = _rest(rows["sh"], level, bounds, degree)
    quats = rows["quat"].astype(np.float32)
    return RawGaussians(means, quats, log_scales, logits_of_bytes(rows["rgba"][:, 3]), sh), end


def _row(level: int, rest: int) -> np.dtype[np.void]:
    center, value, coefficient = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))[level]
    fields = [("mean", center, 3), ("scale", value, 3), ("quat", value, 4), ("rgba", "u1", 4)]
    return np.dtype([*fields, ("sh", coefficient, rest)] if rest else fields)


def _owners(
    count: int, full: int, bucket_size: int, lengths: Int64[np.ndarray, "P"], buckets: int, subject: object
) -> Int64[np.ndarray, "M"]:
    """Return the bucket of each Gaussian: full buckets come first, then partly filled ones of given lengths."""
    in_full = min(count, full * bucket_size)
    edges = np.concatenate([[in_full], in_full + np.cumsum(lengths)])
    index = np.arange(count)
    owner = np.where(
        index < edges[0], index // max(1, bucket_size), full + np.searchsorted(edges, index, side="right") - 1
    )
    if count > edges[-1] or full + len(lengths) > buckets:
        found = f"{buckets} buckets of which {full} full and {len(lengths)} partly, for {count} Gaussians"
        raise InputError(subject, field="buckets", expected="a bucket for every Gaussian", found=found)
    return owner


def _rest(
    stored: Shaped[np.ndarray, "M r"], level: int, bounds: tuple[float, float], degree: int
) -> Float32[np.ndarray, "M K 3"]:
    values = stored.astype(np.float32)
    if level == 2:
        values = (values / 255 * (bounds[1] - bounds[0]) + bounds[0]).astype(np.float32)
    # Degree by degree: first the three channels of degree 1, then those of degree 2.
    blocks = [values[:, :9].reshape(-1, 3, 3)]
    if degree == 2:
        blocks.append(values[:, 9:24].reshape(-1, 3, 5))
    return np.concatenate([block.transpose(0, 2, 1) for block in blocks], axis=1)
