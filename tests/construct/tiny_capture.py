"""A few dozen Gaussians and a walk of small photographs of them, with depth: what training is tried on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.render import color_image, render
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame

WIDTH, HEIGHT = 40, 32
COUNT = 60


@dataclass(frozen=True)
class Held:
    """An image in memory."""

    pixels: np.ndarray

    def read(self) -> np.ndarray:
        return self.pixels


def truth(count: int = COUNT, seed: int = 0) -> Gaussians:
    """Opaque blobs in a box of 2 x 2 x 1 metres about the origin."""
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    return Gaussians(
        means=(rng.uniform(-1, 1, (count, 3)) * [1.0, 1.0, 0.5]).astype(np.float32),
        quats=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        log_scales=np.log(rng.uniform(0.1, 0.3, (count, 3))).astype(np.float32),
        opacity_logits=np.full(count, 2.0, np.float32),
        sh=rng.uniform(-1.5, 1.5, (count, 1, 3)).astype(np.float32),
    )


def cameras(count: int, width: int = WIDTH, height: int = HEIGHT) -> list[Camera]:
    """An arc 3 m away."""
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], float)
    angles = np.linspace(-0.6, 0.6, count)
    eyes = [np.array([3 * np.sin(a), 0.4 * np.cos(3 * a), -3 * np.cos(a)]) for a in angles]
    return [Camera(K, look_at(eye, np.zeros(3), np.array([0, -1.0, 0])), width, height) for eye in eyes]


def frames(
    gaussians: Gaussians, count: int = 6, *, with_depth: bool = True, width: int = WIDTH, height: int = HEIGHT
) -> list[Frame]:
    """Photographs, and depth where something is seen."""
    made = []
    for k, camera in enumerate(cameras(count, width, height)):
        rendering = render(gaussians, camera, ("color", "depth", "alpha"))
        depth_m = np.where(rendering.alpha > 0.5, rendering.depth, np.float32(0))
        made.append(Frame(f"{k:03d}", camera, Held(color_image(rendering)), Held(depth_m) if with_depth else None))
    return made


def disturbed(gaussians: Gaussians, by: float = 0.03, seed: int = 1) -> Gaussians:
    """The same Gaussians moved, turned grey and half faded."""
    rng = np.random.default_rng(seed)
    return replace(
        gaussians,
        means=gaussians.means + rng.normal(0, by, gaussians.means.shape).astype(np.float32),
        opacity_logits=np.zeros_like(gaussians.opacity_logits),
        sh=0.3 * gaussians.sh,
    )
