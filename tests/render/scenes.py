"""Small scenes and cameras for the render tests, and the measures that compare two renderings."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.render import Rendering
from pipeline.scene.gaussians import Gaussians

LEAST_PSNR_DB = 90.0
"""Issue 3's bound on colour error against float64; these small scenes reach 110 dB and more."""
LEAST_DOMINANT_AGREEMENT = 0.9999
"""Two nearly equal weights, or an alpha next to 1/255, may fall either way in float32."""
LARGEST_DEPTH_ERROR = 1e-4
"""Relative, on all but `DEPTH_OUTLIERS` of the pixels."""
DEPTH_OUTLIERS = 1e-3
"""Share of pixels where one contribution next to 1/255 (or a stop next to 1e-4) may be counted by one side only."""

UP = np.array([0.0, 0.0, 1.0])


def camera(width: int = 96, height: int = 64, *, focal: float = 80.0, eye=(3.0, 2.0, 1.0), target=(0.0, 0.0, 0.0)):
    """A camera that looks at the scene's middle from 3.7 m."""
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Camera(K, look_at(np.array(eye, np.float64), np.array(target, np.float64), UP), width, height)


def front_camera(width: int = 33, height: int = 33, *, focal: float = 40.0) -> Camera:
    """A camera at the origin that looks along +z, with no rotation: coordinates are camera coordinates."""
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Camera(K, np.eye(3, 4), width, height)


def random_scene(seed: int, count: int = 300, *, sh_degree: int = 1, offset=(0.0, 0.0, 0.0)) -> Gaussians:
    """Gaussians of many sizes, shapes, opacities and colours in a cube of 4 m around `offset`."""
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=(rng.uniform(-2, 2, (count, 3)) + np.asarray(offset)).astype(np.float32),
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        log_scales=np.log(rng.uniform(0.005, 0.4, (count, 3))).astype(np.float32),
        opacity_logits=rng.normal(0, 2, count).astype(np.float32),
        sh=rng.normal(0, 0.4, (count, (sh_degree + 1) ** 2, 3)).astype(np.float32),
    )


def gaussians(
    means, *, scales=0.1, opacity_logits=2.0, quats=(1.0, 0.0, 0.0, 0.0), colors=(0.5, 0.5, 0.5)
) -> Gaussians:
    """Gaussians given one by one; everything but the means may be shared. Colours are linear RGB seen from anywhere."""
    means = np.atleast_2d(np.asarray(means, np.float32))
    count = len(means)
    with np.errstate(divide="ignore"):
        log_scales = np.log(np.broadcast_to(np.asarray(scales, np.float64), (count, 3)))
    sh = (np.broadcast_to(np.asarray(colors, np.float64), (count, 3)) - 0.5) / 0.28209479177387814
    return Gaussians(
        means=means,
        quats=np.broadcast_to(np.asarray(quats, np.float32), (count, 4)).copy(),
        log_scales=log_scales.astype(np.float32),
        opacity_logits=np.broadcast_to(np.asarray(opacity_logits, np.float32), (count,)).copy(),
        sh=sh.astype(np.float32)[:, None, :].copy(),
    )


def psnr_db(image: np.ndarray, truth: np.ndarray) -> float:
    """Peak signal (1.0) to noise, decibels; infinite for equal images."""
    error = float(np.mean((image.astype(np.float64) - truth) ** 2))
    return float("inf") if error == 0 else -10.0 * np.log10(error)


def assert_matches(found: Rendering, truth: Rendering, *, least_psnr_db: float = LEAST_PSNR_DB) -> None:
    """Hold all outputs of a rendering to the reference's."""
    assert psnr_db(found.color, truth.color) >= least_psnr_db
    assert psnr_db(found.alpha, truth.alpha) >= least_psnr_db
    assert np.mean(found.dominant == truth.dominant) >= LEAST_DOMINANT_AGREEMENT
    assert psnr_db(found.dominant_weight, truth.dominant_weight) >= least_psnr_db
    error = np.abs(found.depth - truth.depth) / np.maximum(truth.depth, 1e-6)
    assert np.mean(error > LARGEST_DEPTH_ERROR) <= DEPTH_OUTLIERS
    np.testing.assert_array_equal(found.dominant >= 0, found.alpha > 0)


def assert_same_bits(one: Rendering, other: Rendering) -> None:
    """Every output of two renderings is equal, or absent from both."""
    for name in ("color", "depth", "alpha", "dominant", "dominant_weight"):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        if a is not None:
            np.testing.assert_array_equal(a, b, err_msg=name)
