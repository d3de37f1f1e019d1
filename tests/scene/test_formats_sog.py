"""SOG: bundles and folders of both versions, and every part that can be missing, small or lossy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.formats import load_gaussians, read_gaussians
from schemas.errors import InputError
from tests.scene.comparing import assert_near, write
from tests.scene.encoders import sog, sog_bundle, webp, zipped
from tests.scene.making import random_gaussians

# Means: 16 bits over the log range; the rest: 8 bits of ranges of about 5, 8 (logits) and 1.8.
STEPS = {"mean": 3e-3, "scale": 0.02, "dc": 0.01, "rest": 0.01, "angle": 1.5}


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_version_2_reads_to_quantisation(tmp_path: Path, degree: int) -> None:
    made = random_gaussians(degree=degree)
    file = read_gaussians(write(tmp_path, sog_bundle(made), "a.sog"))
    assert file.format == "sog"
    assert_near(file.gaussians, made, **STEPS)


@pytest.mark.parametrize("degree", [0, 3])
def test_version_1_reads_to_quantisation(tmp_path: Path, degree: int) -> None:
    made = random_gaussians(degree=degree)
    read = load_gaussians(write(tmp_path, sog_bundle(made, version=1), "a.sog"))
    np.testing.assert_allclose(read.opacity_logits, made.opacity_logits, atol=8 / 255)
    np.testing.assert_allclose(read.means, made.means, atol=3e-3)
    np.testing.assert_allclose(read.sh, made.sh, atol=0.01)


def test_folder_reads_like_the_bundle(tmp_path: Path) -> None:
    made = random_gaussians(degree=1)
    for name, data in sog(made).items():
        write(tmp_path, data, name)
    folder = load_gaussians(str(tmp_path / "meta.json"))
    bundle = load_gaussians(write(tmp_path, sog_bundle(made), "a.sog"))
    assert folder.sh.tobytes() == bundle.sh.tobytes()
    assert folder.means.tobytes() == bundle.means.tobytes()


def test_palette_wider_than_a_row_reads(tmp_path: Path) -> None:
    made = random_gaussians(200, degree=1)
    read = load_gaussians(write(tmp_path, sog_bundle(made), "a.sog"))
    np.testing.assert_allclose(read.sh, made.sh, atol=0.01)


@pytest.mark.parametrize("name", ["meta.json", "l.webp", "q.webp", "c.webp"])
def test_missing_member_is_named(tmp_path: Path, name: str) -> None:
    files = sog(random_gaussians(degree=0))
    del files[name]
    with pytest.raises(InputError) as caught:
        load_gaussians(write(tmp_path, zipped(files), "a.sog"))
    assert caught.value.field == name


def test_names_outside_the_folder_are_refused(tmp_path: Path) -> None:
    files = sog(random_gaussians(degree=0))
    files["meta.json"] = files["meta.json"].replace(b"l.webp", b"../l.webp")
    with pytest.raises(InputError, match="names of images beside"):
        load_gaussians(write(tmp_path, zipped(files), "a.sog"))


def test_lossy_image_is_refused(tmp_path: Path) -> None:
    files = sog(random_gaussians(degree=0))
    files["s.webp"] = webp(np.random.default_rng(0).integers(0, 255, (40, 3)), lossless=False)
    with pytest.raises(InputError, match=r"s\.webp: expected lossless WebP"):
        load_gaussians(write(tmp_path, zipped(files), "a.sog"))


def test_image_too_small_for_the_count_is_refused(tmp_path: Path) -> None:
    files = sog(random_gaussians(degree=0))
    files["s.webp"] = webp(np.zeros((8, 3)))
    with pytest.raises(InputError, match="scales: expected at least 40 pixels, found 8"):
        load_gaussians(write(tmp_path, zipped(files), "a.sog"))


@pytest.mark.parametrize(
    "broken",
    [b"[]", b"{}", b"{", b'{"version": 3}', b'{"version": 2, "count": "many"}', b'{"version": 2, "count": 4}'],
)
def test_broken_meta_is_an_input_error(tmp_path: Path, broken: bytes) -> None:
    files = {**sog(random_gaussians(degree=0)), "meta.json": broken}
    with pytest.raises(InputError):
        load_gaussians(write(tmp_path, zipped(files), "a.sog"))
