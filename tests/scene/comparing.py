"""How near two sets of Gaussians are, each parameter in its own unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.geometry import quats_to_rotations
from pipeline.scene import Gaussians

OPACITY_STEP = 0.51 / 255
"""Opacities are rounded to 1/255."""


def write(folder: Path, data: bytes, name: str) -> str:
    path = folder / name
    path.write_bytes(data)
    return str(path)


def opacities(gaussians: Gaussians) -> np.ndarray:
    return 1 / (1 + np.exp(-gaussians.opacity_logits.astype(float)))


def angles_deg(a: Gaussians, b: Gaussians) -> np.ndarray:
    turns = np.swapaxes(quats_to_rotations(a.quats), 1, 2) @ quats_to_rotations(b.quats)
    return np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))


def assert_near(read: Gaussians, made: Gaussians, *, mean: float, scale: float, dc: float, rest: float, angle: float):
    np.testing.assert_allclose(read.means, made.means, atol=mean)
    np.testing.assert_allclose(read.log_scales, made.log_scales, atol=scale)
    np.testing.assert_allclose(opacities(read), opacities(made), atol=OPACITY_STEP)
    np.testing.assert_allclose(read.sh[:, 0], made.sh[:, 0], atol=dc)
    np.testing.assert_allclose(read.sh[:, 1:], made.sh[:, 1:], atol=rest)
    assert angles_deg(read, made).max() < angle
