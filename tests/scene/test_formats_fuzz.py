"""Damaged splat files: every truncation and random byte flips give Gaussians or an InputError, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.formats import read_gaussians
from schemas.errors import InputError
from tests.scene.encoders import compressed_ply, ksplat, sog, sog_bundle, splat, spz, version_4, zipped
from tests.scene.making import inria_columns, ply, random_gaussians

FLIPS = 250
"""Damaged copies a format; each takes about a millisecond."""

MAKERS: dict[str, Callable[[], bytes]] = {
    "a.ply": lambda: ply(inria_columns(random_gaussians(6, degree=1))),
    "ascii.ply": lambda: ply(inria_columns(random_gaussians(6, degree=0)), form="ascii"),
    "packed.ply": lambda: compressed_ply(random_gaussians(6, degree=1)),
    "gzip.spz": lambda: spz(random_gaussians(6, degree=1)),
    "bare.spz": lambda: spz(random_gaussians(6, degree=1), compress=False),
    "zstd.spz": lambda: version_4(spz(random_gaussians(6, degree=1), compress=False)),
    "a.sog": lambda: sog_bundle(random_gaussians(6, degree=1)),
    "a.splat": lambda: splat(random_gaussians(6, degree=0)),
    "plain.ksplat": lambda: ksplat(random_gaussians(6, degree=1), 0, 4),
    "packed.ksplat": lambda: ksplat(random_gaussians(6, degree=1), 1, 4),
}


def read_or_refuse(path: Path, data: bytes) -> bool:
    """Whether the bytes were read; what is read must be finite Gaussians, what is not an error that names the file."""
    path.write_bytes(data)
    file = subject = None
    try:
        file = read_gaussians(str(path))
    except InputError as error:
        subject = error.subject
    if file is None:
        assert subject == str(path)
        return False
    assert len(file.gaussians) == int(file.kept.sum()) == len(file.kept) - sum(file.dropped.values())
    assert np.isfinite(file.gaussians.means).all()
    return True


@pytest.mark.parametrize("name", MAKERS)
def test_undamaged_file_reads(tmp_path: Path, name: str) -> None:
    assert read_or_refuse(tmp_path / name, MAKERS[name]())


@pytest.mark.parametrize("name", MAKERS)
def test_truncated_file_is_refused(tmp_path: Path, name: str) -> None:
    data = MAKERS[name]()
    ends = sorted({*range(0, len(data), max(1, len(data) // 150)), len(data) - 1, 1, 2, 3, 4})
    read = [end for end in ends if read_or_refuse(tmp_path / name, data[:end])]
    # A .splat cut between rows is a shorter .splat, and ASCII may lose the last digits of its last number.
    whole = (32 if name == "a.splat" else 1) if name in ("a.splat", "ascii.ply") else None
    assert all(whole is not None and end % whole == 0 and (whole == 32 or end > len(data) - 20) for end in read)


@pytest.mark.parametrize("name", MAKERS)
def test_flipped_bytes_are_read_or_refused(tmp_path: Path, name: str) -> None:
    data, rng = MAKERS[name](), np.random.default_rng(7)
    hot = np.flatnonzero(np.frombuffer(data, np.uint8))  # mostly headers, in files that are mostly padding
    for _ in range(FLIPS):
        damaged = bytearray(data)
        for at in rng.choice(hot if rng.random() < 0.7 else len(data), rng.integers(1, 4)):
            damaged[at] = rng.integers(256)
        read_or_refuse(tmp_path / name, bytes(damaged))


def test_flipped_bytes_inside_a_sound_archive_are_read_or_refused(tmp_path: Path) -> None:
    files, rng = sog(random_gaussians(6, degree=1)), np.random.default_rng(8)
    for _ in range(FLIPS):
        name = rng.choice(list(files))
        damaged = bytearray(files[name])
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        read_or_refuse(tmp_path / "a.sog", zipped({**files, name: bytes(damaged)}))


@pytest.mark.parametrize("name", MAKERS)
def test_random_bytes_under_every_name_are_refused_or_read(tmp_path: Path, name: str) -> None:
    rng = np.random.default_rng(3)
    for size in (0, 1, 31, 32, 100, 5000):
        read_or_refuse(tmp_path / name, rng.bytes(size))
