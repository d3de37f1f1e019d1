"""Which format a splat file is in, by its bytes where they say so and by its name where they cannot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from pipeline.scene.formats.compressed_ply import is_compressed, read_compressed_ply
from pipeline.scene.formats.ksplat import read_ksplat
from pipeline.scene.formats.ply import ply_bytes, read_ply
from pipeline.scene.formats.ply_header import parse_header
from pipeline.scene.formats.raw import RawGaussians, keep_usable, suspicious_values
from pipeline.scene.formats.sog import META, ZIP, read_sog, read_sog_parts
from pipeline.scene.formats.splat import read_splat
from pipeline.scene.formats.spz import GZIP, MAGIC, read_spz
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError
from schemas.storage import join, name_of, read_bytes, write_bytes_atomic

SUFFIXES = (".ply", ".spz", ".sog", ".splat", ".ksplat")
"""Names of splat files; a SOG folder is named by its meta.json."""

READABLE = "a splat file (PLY, compressed PLY, SPZ, SOG, .splat, .ksplat)"


@dataclass(frozen=True, slots=True)
class GaussiansFile:
    """What a splat file held."""

    gaussians: Gaussians
    """The usable Gaussians, in file order."""
    kept: Bool[np.ndarray, "F"]
    """Which of the file's F Gaussians those are."""
    dropped: dict[str, int]
    """Gaussians left out, by reason."""
    format: str
    """ply, compressed ply, spz, sog, splat or ksplat."""
    warnings: tuple[str, ...] = ()
    """What was dropped, assumed or looks wrong, one line each."""


def load_gaussians(uri: str) -> Gaussians:
    """Return the usable Gaussians of a splat file; `read_gaussians` also says what was dropped.

    Raises:
        InputError: As for `read_gaussians`.
    """
    return read_gaussians(uri).gaussians


def read_gaussians(uri: str) -> GaussiansFile:
    """Return the usable Gaussians of a splat file and what was left out.

    Args:
        uri: Path or URI of a PLY, compressed PLY, SPZ, SOG (.sog, or meta.json of a folder), .splat or .ksplat file.

    Raises:
        InputError: The file is missing, of no known format, truncated or corrupt, lacks a field, or holds no
            usable Gaussian.
        RetryError: A remote store failed to answer.
    """
    uri = str(uri)
    # A damaged file holds any bits: what overflows on the way becomes infinite or NaN, and is dropped by reason.
    with np.errstate(all="ignore"):
        kind, raw = _read(uri)
    gaussians, kept, dropped = keep_usable(raw)
    if not len(gaussians):
        found = ", ".join(f"{count} dropped: {reason}" for reason, count in dropped.items()) or "none"
        raise InputError(uri, expected="at least one usable Gaussian", found=found)
    lines = [f"dropped {count} Gaussians: {reason}" for reason, count in dropped.items()]
    warnings = tuple(f"{name_of(uri)}: {line}" for line in (*lines, *raw.warnings, *suspicious_values(raw)))
    return GaussiansFile(gaussians, kept, dropped, kind, warnings)


def save_gaussians(gaussians: Gaussians, path: str) -> None:
    """Write an Inria PLY, atomically; reading it gives the same bits back.

    Raises:
        InputError: The place may not be written.
    """
    write_bytes_atomic(str(path), ply_bytes(gaussians))


def _read(uri: str) -> tuple[str, RawGaussians]:
    name = name_of(uri).lower()
    data = read_bytes(uri)
    if data[:3] == b"ply":
        header = parse_header(data, uri)
        if is_compressed(header):
            return "compressed ply", read_compressed_ply(data, header, uri)
        return "ply", read_ply(data, header, uri)
    if data[:4] == MAGIC or data[:2] == GZIP:
        return "spz", read_spz(data, uri)
    if data[:4] == ZIP and not name.endswith((".pt", ".pth", ".npz")):
        return "sog", read_sog(data, uri)
    if name == META:
        folder = uri[: -len(META)].rstrip("/") or ("/" if uri.startswith("/") else ".")
        return "sog", read_sog_parts(lambda part: data if part == META else read_bytes(join(folder, part)), uri)
    if name.endswith(".splat"):
        return "splat", read_splat(data, uri)
    if name.endswith(".ksplat"):
        return "ksplat", read_ksplat(data, uri)
    if name.endswith(".ply"):
        raise InputError(uri, expected='a PLY header ("ply" to "end_header")', found=repr(data[:8]))
    if name.endswith((".pt", ".pth", ".ckpt", ".pkl")):
        raise InputError(uri, expected=READABLE, found="a pickled checkpoint, which is never opened: export it to PLY")
    raise InputError(uri, expected=READABLE, found=repr(data[:8]))
