"""Real trained splats: held to the reference, and the same object from two formats to each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.render import render, render_reference
from pipeline.scene.formats import load_gaussians
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import UP, assert_matches, psnr_db

LEAST_FORMAT_PSNR_DB = 50.0
"""Compressed PLY and SPZ quantise differently; 58 dB were measured."""


def outside_view(scene: Gaussians, width: int, height: int) -> Camera:
    """A camera that sees most of an object from the side."""
    low, high = np.quantile(scene.means, [0.02, 0.98], axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    return Camera(K, look_at(middle + size * np.array([0.9, 0.5, 0.3]), middle, UP), width, height)


def test_trained_gaussians_of_degree_3_match_the_reference(shared_data: Path) -> None:
    scene = load_gaussians(str(shared_data / "splat_files" / "train-1000.ply"))
    view = outside_view(scene, 120, 90)
    found = render(scene, view)
    assert found.alpha.mean() > 0.02
    assert_matches(found, render_reference(scene, view))


def test_one_object_from_two_formats_looks_the_same(shared_data: Path) -> None:
    one = load_gaussians(str(shared_data / "splat_files" / "biker.compressed.ply"))
    other = load_gaussians(str(shared_data / "splat_files" / "biker.spz"))
    view = outside_view(one, 160, 120)
    found, again = render(one, view), render(other, view)
    assert found.alpha.mean() > 0.05
    assert psnr_db(np.clip(found.color, 0, 1), np.clip(again.color, 0, 1)) >= LEAST_FORMAT_PSNR_DB
