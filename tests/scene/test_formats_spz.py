"""SPZ: versions 1 to 4, bare or packed, read to quantisation in the axes of PLY."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.formats import load_gaussians, read_gaussians
from schemas.errors import InputError
from tests.scene.comparing import angles_deg, assert_near, opacities, write
from tests.scene.encoders import spz, version_4
from tests.scene.making import random_gaussians

# 12 bits of fraction; 1/16 log scale; 0.15 x 255 steps a unit of colour; 1/128 a unit of the rest.
# Up to version 2, w is the root of what three bytes leave of 1: at w near 0 half a step is up to 18 degrees.
STEPS = {"mean": 0.51 / 4096, "scale": 0.51 / 16, "dc": 0.51 / (0.15 * 255), "rest": 0.51 / 128}


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize(("version", "angle"), [(2, 18.0), (3, 0.3)])
def test_gzipped_versions_read_to_quantisation_in_ply_axes(
    tmp_path: Path, degree: int, version: int, angle: float
) -> None:
    made = random_gaussians(degree=degree)
    read = load_gaussians(write(tmp_path, spz(made, version), "a.spz"))
    assert_near(read, made, **STEPS, angle=angle)


def test_version_1_with_half_floats_reads(tmp_path: Path) -> None:
    made = random_gaussians(degree=1)
    read = load_gaussians(write(tmp_path, spz(made, 1), "a.spz"))
    assert_near(read, made, **{**STEPS, "mean": 2e-3}, angle=18.0)


def test_bare_bytes_read_like_the_gzipped_ones(tmp_path: Path) -> None:
    made = random_gaussians(degree=2)
    packed = load_gaussians(write(tmp_path, spz(made), "a.spz"))
    bare = load_gaussians(write(tmp_path, spz(made, compress=False), "b.spz"))
    assert packed.sh.tobytes() == bare.sh.tobytes()
    assert packed.means.tobytes() == bare.means.tobytes()


@pytest.mark.parametrize("degree", [0, 3])
def test_version_4_reads_like_version_3(tmp_path: Path, degree: int) -> None:
    made = random_gaussians(degree=degree)
    old = spz(made, 3, compress=False)
    three = load_gaussians(write(tmp_path, old, "a.spz"))
    four = load_gaussians(write(tmp_path, version_4(old), "b.spz"))
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(three, name), getattr(four, name))


def test_degree_4_loses_its_last_band_with_a_warning(tmp_path: Path) -> None:
    made = random_gaussians(6, degree=3)
    data = bytearray(spz(made, 3, compress=False))
    data[12] = 4
    rest = np.frombuffer(bytes(data[-6 * 45 :]), np.uint8).reshape(6, 15, 3)
    wider = np.concatenate([rest, np.full((6, 9, 3), 7, np.uint8)], axis=1)
    file = read_gaussians(write(tmp_path, bytes(data[: -6 * 45]) + wider.tobytes(), "a.spz"))
    assert_near(file.gaussians, made, **STEPS, angle=0.3)
    assert any("degree 4" in line for line in file.warnings)


@pytest.mark.parametrize(
    ("at", "value", "field"), [(4, 9, "version"), (12, 5, "sh_degree"), (13, 31, "fractional_bits")]
)
def test_unknown_header_values_are_named(tmp_path: Path, at: int, value: int, field: str) -> None:
    data = bytearray(spz(random_gaussians(4), compress=False))
    data[at] = value
    with pytest.raises(InputError) as caught:
        load_gaussians(write(tmp_path, bytes(data), "a.spz"))
    assert caught.value.field == field


@pytest.mark.parametrize("compress", [True, False])
def test_extension_records_are_passed_over_only_where_the_flag_says_so(tmp_path: Path, compress: bool) -> None:
    made = random_gaussians(5, degree=1)
    data = bytearray(spz(made, compress=False) + b"other tools' record")
    pack = gzip.compress if compress else bytes
    with pytest.raises(InputError, match="bytes for 5 Gaussians"):
        load_gaussians(write(tmp_path, pack(bytes(data)), "a.spz"))
    data[14] = 2
    assert_near(load_gaussians(write(tmp_path, pack(bytes(data)), "a.spz")), made, **STEPS, angle=0.3)


def test_antialiased_training_is_noted(tmp_path: Path) -> None:
    data = bytearray(spz(random_gaussians(5, degree=0), compress=False))
    assert not read_gaussians(write(tmp_path, bytes(data), "a.spz")).warnings
    data[14] = 1
    assert "antialias" in read_gaussians(write(tmp_path, bytes(data), "a.spz")).warnings[0]


def test_gzip_bomb_header_is_refused_without_unpacking_it(tmp_path: Path) -> None:
    data = bytearray(spz(random_gaussians(4), compress=False))
    data[8:12] = b"\xff\xff\xff\xff"
    with pytest.raises(InputError, match="bytes for 4294967295 Gaussians"):
        load_gaussians(write(tmp_path, gzip.compress(bytes(data)), "a.spz"))


def test_same_object_as_ply_and_spz_agrees_to_quantisation(shared_data: Path) -> None:
    folder = shared_data / "splat_files"
    a, b = load_gaussians(str(folder / "biker.compressed.ply")), load_gaussians(str(folder / "biker.spz"))
    assert len(a) == len(b) == 152_746
    # Half a step of SPZ, plus the PLY's own step: its chunks span about 0.3 m in 1023 steps.
    np.testing.assert_allclose(a.means, b.means, atol=0.5 / 4096 + 2e-4)
    np.testing.assert_allclose(np.maximum(a.log_scales, -10), b.log_scales, atol=0.5 / 16 + 2e-3)
    np.testing.assert_allclose(opacities(a), opacities(b), atol=1e-6)
    np.testing.assert_allclose(a.sh, b.sh, atol=0.51 / (0.15 * 255))
    assert angles_deg(a, b).max() < 0.3


@pytest.mark.parametrize("name", ["minimal-v3.spz", "minimal-v4.spz"])
def test_minimal_files_agree_with_the_same_object_in_other_formats(shared_data: Path, name: str) -> None:
    folder = shared_data / "splat_files"
    spz_file, splat_file = load_gaussians(str(folder / name)), load_gaussians(str(folder / "minimal.splat"))
    np.testing.assert_allclose(spz_file.means, splat_file.means, atol=1e-6)
    np.testing.assert_allclose(spz_file.sh, splat_file.sh, atol=0.51 / (0.15 * 255))


def test_another_reader_sees_the_same_numbers_before_the_turn(tmp_path: Path) -> None:
    gsply = pytest.importorskip("gsply")
    path = write(tmp_path, spz(random_gaussians(degree=2)), "a.spz")
    theirs, ours = gsply.read_spz(path), load_gaussians(path)
    np.testing.assert_allclose(ours.means * (1, -1, -1), theirs.means, atol=1e-6)
    np.testing.assert_allclose(ours.log_scales, theirs.scales, atol=1e-6)
    np.testing.assert_allclose(np.abs(ours.quats), np.abs(theirs.quats), atol=1e-6)
    np.testing.assert_allclose(np.abs(ours.sh[:, 1:]), np.abs(theirs.shN), atol=1e-6)
