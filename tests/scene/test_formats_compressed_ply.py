"""Compressed PLY: against an encoder written apart, another reader, and bytes decoded by hand."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.scene import Gaussians
from pipeline.scene.formats import load_gaussians, read_gaussians
from schemas.errors import InputError
from tests.scene.comparing import assert_near, opacities, write
from tests.scene.encoders import C0, compressed_ply
from tests.scene.making import random_gaussians

# The widest chunk axis spans about 6 m in 1023 steps; log scales 5 in 1023; coefficients 8 in 256.
STEPS = {"mean": 6 / 1023, "scale": 5 / 1023, "dc": 0.006, "rest": 4 / 256, "angle": 0.25}


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_reads_what_an_encoder_written_apart_made(tmp_path: Path, degree: int) -> None:
    made = random_gaussians(300, degree=degree)
    file = read_gaussians(write(tmp_path, compressed_ply(made), "a.ply"))
    assert file.format == "compressed ply"
    assert_near(file.gaussians, made, **STEPS)


@pytest.mark.parametrize("degree", [0, 2])
def test_another_reader_agrees(tmp_path: Path, degree: int) -> None:
    gsply = pytest.importorskip("gsply")
    path = write(tmp_path, compressed_ply(random_gaussians(300, degree=degree)), "a.ply")
    assert_same_as_gsply(load_gaussians(path), gsply.plyread(path))


@pytest.mark.parametrize("name", ["biker.compressed.ply", "guitar.compressed.ply"])
def test_another_reader_agrees_on_real_files(shared_data: Path, name: str) -> None:
    gsply = pytest.importorskip("gsply")
    path = shared_data / "splat_files" / name
    assert_same_as_gsply(load_gaussians(str(path)), gsply.plyread(path))


def test_real_file_decoded_by_hand(shared_data: Path) -> None:
    data = (shared_data / "splat_files" / "guitar.compressed.ply").read_bytes()
    read = load_gaussians(str(shared_data / "splat_files" / "guitar.compressed.ply"))
    body = data.index(b"end_header\n") + len(b"end_header\n")
    for i in (0, 255, 256, 90_853):
        chunk = struct.unpack_from("<18f", data, body + 72 * (i // 256))
        position, _, scale, color = struct.unpack_from("<4I", data, body + 72 * 355 + 16 * i)
        parts = [(position >> 21) / 2047, (position >> 11 & 1023) / 1023, (position & 2047) / 2047]
        mean = [low + (high - low) * part for low, high, part in zip(chunk[0:3], chunk[3:6], parts, strict=True)]
        np.testing.assert_allclose(read.means[i], mean, atol=1e-5)
        size = chunk[6] + (chunk[9] - chunk[6]) * (scale >> 21) / 2047
        assert read.log_scales[i, 0] == pytest.approx(size, abs=1e-5)
        red = chunk[12] + (chunk[15] - chunk[12]) * (color >> 24) / 255
        assert 0.5 + C0 * read.sh[i, 0, 0] == pytest.approx(red, abs=1e-5)
        assert opacities(read)[i] == pytest.approx((color & 255) / 255, abs=1e-6)


def test_too_few_chunks_is_an_input_error(tmp_path: Path) -> None:
    data = compressed_ply(random_gaussians(300, degree=0)).replace(b"element chunk 2", b"element chunk 1")
    with pytest.raises(InputError, match="chunk: expected 2 chunks for 300 vertices, found 1"):
        load_gaussians(write(tmp_path, data, "a.ply"))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        (b"property uint packed_scale", b"property uint packed_stale", "packed_scale"),
        (b"property float max_scale_y", b"property float max_stale_y", "max_scale_y"),
        (b"property uchar f_rest_3", b"property uchar f_west_3", "sh"),
        (b"element sh 300", b"element sh 299", "sh"),
    ],
)
def test_missing_part_is_named(tmp_path: Path, old: bytes, new: bytes, field: str) -> None:
    data = compressed_ply(random_gaussians(300, degree=1))
    assert old in data
    with pytest.raises(InputError) as caught:
        load_gaussians(write(tmp_path, data.replace(old, new), "a.ply"))
    assert caught.value.field == field


def assert_same_as_gsply(ours: Gaussians, theirs: Any) -> None:
    np.testing.assert_allclose(ours.means, theirs.means, atol=1e-5)
    np.testing.assert_allclose(ours.log_scales, theirs.scales, atol=1e-5)
    np.testing.assert_allclose(ours.quats, theirs.quats, atol=1e-5)
    np.testing.assert_allclose(ours.sh[:, 0], theirs.sh0, atol=1e-5)
    np.testing.assert_allclose(ours.sh[:, 1:], theirs.shN, atol=1e-5)
    # It stands in logits of 10 for opacities of exactly 0 and 1; ours are infinite.
    inside = np.isfinite(ours.opacity_logits)
    np.testing.assert_allclose(ours.opacity_logits[inside], theirs.opacities[inside], atol=1e-4)
    assert (np.abs(theirs.opacities[~inside]) == 10).all()
