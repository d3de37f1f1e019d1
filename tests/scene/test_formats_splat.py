"""`.splat` and `.ksplat`: against encoders written apart and each other."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.formats import load_gaussians, read_gaussians
from pipeline.scene.formats.raw import logits_of_bytes
from schemas.errors import InputError
from tests.scene.comparing import assert_near, write
from tests.scene.encoders import C0, ksplat, splat
from tests.scene.making import random_gaussians


def test_stored_opacities_become_logits_with_both_ends_exact() -> None:
    logits = logits_of_bytes(np.arange(256, dtype=np.uint8))
    assert logits[0] == -np.inf
    assert logits[255] == np.inf
    np.testing.assert_allclose(1 / (1 + np.exp(-logits.astype(float))), np.arange(256) / 255, atol=1e-7)


class TestSplat:
    def test_reads_what_an_encoder_written_apart_made(self, tmp_path: Path) -> None:
        made = random_gaussians(degree=0)
        read = load_gaussians(write(tmp_path, splat(made), "a.splat"))
        assert_near(read, made, mean=0, scale=1e-5, dc=0.51 / 255 / C0, rest=0, angle=1.0)

    def test_scale_of_zero_is_a_flat_axis_and_a_negative_one_is_dropped(self, tmp_path: Path) -> None:
        data = bytearray(splat(random_gaussians(4, degree=0)))
        data[12:16] = struct.pack("<f", 0.0)
        data[32 + 12 : 32 + 16] = struct.pack("<f", -1.0)
        file = read_gaussians(write(tmp_path, bytes(data), "a.splat"))
        assert file.gaussians.log_scales[0, 0] == -np.inf
        assert file.dropped == {"scale not finite": 1}

    def test_length_of_no_whole_rows_is_an_input_error(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="multiple of 32 bytes, found 127 bytes"):
            load_gaussians(write(tmp_path, splat(random_gaussians(4, degree=0))[:-1], "a.splat"))


class TestKsplat:
    @pytest.mark.parametrize("degree", [0, 1, 2])
    @pytest.mark.parametrize("level", [0, 1, 2])
    def test_every_level_and_degree_reads_to_quantisation(self, tmp_path: Path, level: int, degree: int) -> None:
        made = random_gaussians(37, degree=degree)
        file = read_gaussians(write(tmp_path, ksplat(made, level), "a.ksplat"))
        assert file.format == "ksplat"
        rest = {0: 1e-6, 1: 1e-3, 2: 0.51 / 127}[level]
        assert_near(file.gaussians, made, mean=2e-4, scale=2e-2, dc=0.51 / 255 / C0, rest=rest, angle=0.2)

    def test_minimal_file_agrees_with_the_same_object_as_splat(self, shared_data: Path) -> None:
        folder = shared_data / "splat_files"
        a, b = load_gaussians(str(folder / "minimal.ksplat")), load_gaussians(str(folder / "minimal.splat"))
        np.testing.assert_array_equal(a.means, b.means)
        np.testing.assert_array_equal(a.sh, b.sh)
        np.testing.assert_array_equal(a.log_scales, b.log_scales)

    @pytest.mark.parametrize(
        ("at", "form", "value", "field"),
        [
            (0, "B", 7, "version"),
            (20, "H", 3, "compression level"),
            (4, "I", 4_000_000_000, "sections"),
            (4, "I", 0, "sections"),
            (4096, "I", 4_000_000_000, "section"),
            (4096 + 12, "I", 4_000_000_000, "section"),
            (4096 + 20, "H", 8, "bucket size"),
            (4096 + 32, "I", 0, "buckets"),
            (4096 + 40, "H", 9, "sh degree"),
        ],
    )
    def test_inconsistent_header_is_named(self, tmp_path: Path, at: int, form: str, value: int, field: str) -> None:
        data = bytearray(ksplat(random_gaussians(37, degree=0), 1))
        struct.pack_into("<" + form, data, at, value)
        with pytest.raises(InputError) as caught:
            load_gaussians(write(tmp_path, bytes(data), "a.ksplat"))
        assert caught.value.field == field
