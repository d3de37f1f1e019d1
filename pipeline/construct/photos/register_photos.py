"""Photographs put where the scene says they were taken, for captures whose poses are those of the depth camera.

A depth camera and a colour camera that are not triggered together see a moving hand's path at two moments: poses
tracked on depth are then off for the photographs, by a few pixels that differ from frame to frame. Each photograph is
moved until the rendering of the scene at its pose fits it: Gauss-Newton on six numbers (Baker and Matthews 2004),
coarse to fine, with a gain and an offset for its exposure and outliers weighed down. Depth keeps its own lens and pose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Float64
from PIL import Image

from pipeline.construct.photos.camera_motion import moved
from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, prepare, render
from pipeline.render.threads import run_each
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame

WIDTHS = (80, 160, 320)
"""Widths of the images that are fitted one after the other, pixels: 6 pixels of 640 are less than one of 80."""
ROUNDS = 4
"""Gauss-Newton steps at each width."""
SEEN_ALPHA = 0.9
"""Opacity from which a pixel of the rendering counts."""
FARTHEST = (0.1, 0.1)
"""Metres and radians a photograph is moved at most; one that would go farther stays where it was."""
OUTLIER = 0.1
"""Residual, with colours of 0 to 1, whose weight is a half: things that the scene lacks count for little."""
EXPOSURE_ROUNDS = 3
"""Fits of gain and offset, each without what the last one found to be outliers."""
GAINS = (0.5, 2.0)
"""Gain of a photograph against the scene that is believed."""
_LEAST_PIXELS = 200
"""Pixels below which six numbers are not to be had from an image."""
_STIFFNESS = 1e-4
"""Pull towards no motion, as a share of the mean curvature: directions a flat wall leaves open stay put."""


@dataclass(frozen=True, slots=True)
class RegisteredPhotos:
    """Frames with their photographs' cameras moved."""

    frames: tuple[Frame, ...]
    """As given, with another `camera`; `depth_camera` is set to what `depth_lens` was."""
    moved_m: Float64[np.ndarray, "N"]
    """How far each camera was moved, metres; 0 for one that was left."""
    turned_rad: Float64[np.ndarray, "N"]
    """How far each was turned, radians."""
    error_before: Float64[np.ndarray, "N"]
    """Colour difference to the rendering, 0 to 1, exposure fitted: root mean square with large ones weighed down
    (Cauchy's loss); NaN for a frame without a photograph."""
    error_after: Float64[np.ndarray, "N"]
    """The same at the new pose; never larger."""


def register_photos(
    gaussians: Gaussians,
    frames: Sequence[Frame],
    *,
    centered: bool = True,
    threads: int = 1,
    progress: Callable[[int], object] | None = None,
) -> RegisteredPhotos:
    """Return the frames with each photograph at the pose where the scene's rendering fits it best.

    Args:
        gaussians: A scene whose geometry is to be trusted, such as `fuse` gives; blurred colours are good enough.
        frames: Frames to move. Those without a photograph, and those that do not fit better anywhere, are left.
        centered: Take the mean motion off all frames: what they share belongs to the lens, or to the scene.
        threads: Frames side by side; no number of them changes a result.
        progress: Called with the number of frames done.
    """
    prepared = prepare(gaussians)
    twists, errors = np.zeros((len(frames), 6)), np.full((len(frames), 2), np.nan)
    done = 0

    def work(k: int) -> None:
        nonlocal done
        if frames[k].image is not None:
            twists[k], errors[k] = _register(prepared, frames[k])
        done += 1
        if progress is not None:
            progress(done)

    run_each(work, len(frames), threads)
    if centered and len(frames) > 1:
        twists -= twists.mean(axis=0)
    placed = [
        replace(frame, camera=moved(frame.camera, twist), depth_camera=frame.depth_lens)
        for frame, twist in zip(frames, twists, strict=True)
    ]
    sizes = np.linalg.norm(twists.reshape(-1, 2, 3), axis=2)
    return RegisteredPhotos(tuple(placed), sizes[:, 0], sizes[:, 1], errors[:, 0], errors[:, 1])


def _register(prepared: PreparedGaussians, frame: Frame) -> tuple[Float64[np.ndarray, "6"], tuple[float, float]]:
    """Return the motion of one photograph's camera, and the errors without it and with it."""
    photo = frame.read_image()
    camera = frame.camera
    twist = np.zeros(6)
    for width in WIDTHS:
        small, pixels = _scaled(camera, photo, min(width, camera.width))
        for _ in range(ROUNDS):
            step = _step(prepared, moved(small, twist), pixels)
            if step is None:
                break
            # Both motions are small: their sum is the motion by one after the other.
            twist = twist + step
    before, after = (_error(prepared, moved(small, motion), pixels) for motion in (np.zeros(6), twist))
    far = any(np.linalg.norm(twist[3 * k : 3 * k + 3]) > FARTHEST[k] for k in range(2))
    if far or not after < before:
        return np.zeros(6), (before, before)
    return twist, (before, after)


def _step(
    prepared: PreparedGaussians, camera: Camera, photo: Float32[np.ndarray, "H W 3"]
) -> Float64[np.ndarray, "6"] | None:
    """Return one Gauss-Newton step; None where too little of the scene is seen."""
    color, depth_m, seen = _rendered(prepared, camera)
    if seen.sum() < _LEAST_PIXELS:
        return None
    residual, gain = _residual(color, photo, seen)
    # Mean of the gradients of both images (Malis 2004): second order convergence.
    down, across = (
        0.5 * (gain * ours + theirs)
        for ours, theirs in zip(np.gradient(color, axis=(0, 1)), np.gradient(photo, axis=(0, 1)), strict=True)
    )
    x, y, z = camera.unproject(depth_m)[seen].T
    fx, fy = camera.K[0, 0], camera.K[1, 1]
    zero = np.zeros_like(z)
    u = np.stack([fx / z, zero, -fx * x / z**2, -fx * x * y / z**2, fx * (1 + (x / z) ** 2), -fx * y / z])
    v = np.stack([zero, fy / z, -fy * y / z**2, -fy * (1 + (y / z) ** 2), fy * x * y / z**2, fy * x / z])
    jacobian = -(across[seen][:, None, :] * u.T[:, :, None] + down[seen][:, None, :] * v.T[:, :, None])
    jacobian = jacobian.swapaxes(1, 2).reshape(-1, 6)
    weighed = jacobian * _weights(residual).reshape(-1, 1)
    curvature = weighed.T @ jacobian
    curvature += _STIFFNESS * np.diag(np.diag(curvature).mean() + np.diag(curvature))
    if not np.isfinite(curvature).all() or np.linalg.matrix_rank(curvature) < 6:
        return None
    return np.linalg.solve(curvature, weighed.T @ residual.reshape(-1))


def _error(prepared: PreparedGaussians, camera: Camera, photo: Float32[np.ndarray, "H W 3"]) -> float:
    color, _, seen = _rendered(prepared, camera)
    if seen.sum() < _LEAST_PIXELS:
        return float("inf")
    residual = _residual(color, photo, seen)[0]
    return float(OUTLIER * np.sqrt(np.log1p((residual / OUTLIER) ** 2).mean()))


def _rendered(
    prepared: PreparedGaussians, camera: Camera
) -> tuple[Float32[np.ndarray, "H W 3"], Float32[np.ndarray, "H W"], np.ndarray]:
    rendering = render(prepared, camera, ("color", "depth", "alpha"))
    assert rendering.color is not None, "it was asked for"
    assert rendering.depth is not None, "it was asked for"
    assert rendering.alpha is not None, "it was asked for"
    return rendering.color, rendering.depth, (rendering.alpha >= SEEN_ALPHA) & (rendering.depth > 0)


def _residual(
    color: Float32[np.ndarray, "H W 3"], photo: Float32[np.ndarray, "H W 3"], seen: np.ndarray
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "3"]]:
    """Return photograph minus rendering, of the pixels seen, after a gain and an offset per channel, and that gain."""
    ours, theirs = color[seen], photo[seen]
    weights = np.ones_like(ours)
    for _ in range(EXPOSURE_ROUNDS):
        total = weights.sum(axis=0)
        mean_ours, mean_theirs = (weights * ours).sum(axis=0) / total, (weights * theirs).sum(axis=0) / total
        spread = (weights * (ours - mean_ours) ** 2).sum(axis=0)
        gain = (weights * (ours - mean_ours) * (theirs - mean_theirs)).sum(axis=0) / np.maximum(spread, 1e-6 * total)
        gain = np.clip(gain, *GAINS)
        residual = theirs - mean_theirs - gain * (ours - mean_ours)
        weights = _weights(residual)
    return residual, gain


def _weights(residual: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return Cauchy's weights: a half at `OUTLIER`."""
    return 1.0 / (1.0 + (residual / OUTLIER) ** 2)


def _scaled(camera: Camera, photo: np.ndarray, width: int) -> tuple[Camera, Float32[np.ndarray, "H W 3"]]:
    height = max(1, round(camera.height * width / camera.width))
    image = Image.fromarray(photo).resize((width, height), Image.Resampling.BOX)
    return camera.resized(width, height), np.asarray(image).astype(np.float32) / np.float32(255.0)
