"""The renderer in NumPy float64, one Gaussian after another over the whole image: the meaning of every output.

Obvious rather than fast; tests hold the kernels to it. Depths are rounded to float32 before sorting, as the
rasterisers this follows sort by float32 depth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from pipeline.geometry import Camera, quats_to_rotations
from pipeline.render.lens import Lens
from pipeline.render.prepare import LARGEST_DEVIATION_M
from pipeline.render.quality import EXACT, RenderQuality
from pipeline.render.rendering import Rendering
from pipeline.scene.gaussians import Gaussians

LOW_PASS_PX2 = 0.3
"""Variance added to both image axes: a Gaussian covers about a pixel at least."""
# These and the limits of RenderQuality are taken as float32, as the rasterisers compare with them: two capped layers
# leave 0.99999809e-4, which stops a pixel, where 0.01 * 0.01 in float64 would not.
ALPHA_CAP = float(np.float32(0.99))
"""No single Gaussian is fully opaque."""
T_MIN = float(np.float32(1e-4))
"""A contribution that would leave less transmittance than this is not added, and the pixel stops."""
ANTIALIAS_FLOOR = 2.5e-5
"""Smallest ratio of determinants the antialias option reckons with."""


@dataclass(frozen=True, slots=True)
class Projection:
    """Gaussians in front of the near plane, nearest first, ties by id."""

    ids: Int64[np.ndarray, "n"]
    """Index in the scene."""
    centers: Float64[np.ndarray, "n 2"]
    """Projected means, pixels."""
    conics: Float64[np.ndarray, "n 3"]
    """Inverse 2D covariances (xx, xy, yy), px^-2, low-pass included."""
    opacities: Float64[np.ndarray, "n"]
    """After the sigmoid, 0 to 1."""
    depths: Float64[np.ndarray, "n"]
    """z-depth, metres."""


def project_float64(
    gaussians: Gaussians, camera: Camera, near: float, antialias: bool, *, min_opacity: float = 0.0
) -> Projection:
    """Return the projected Gaussians in compositing order (paper, supplement A.1)."""
    lens = Lens.of(camera)
    local = (gaussians.means.astype(np.float64) - lens.center) @ lens.rotation.T
    depths32 = local[:, 2].astype(np.float32)
    with np.errstate(over="ignore"):
        all_opacities = 1.0 / (1.0 + np.exp(-gaussians.opacity_logits.astype(np.float64)))
    ids = np.flatnonzero((depths32 > np.float32(near)) & (all_opacities >= min_opacity))
    ids = ids[np.lexsort((ids, depths32[ids]))]
    x, y, z = local[ids].T
    (fx, fy), (cx, cy) = lens.focal, lens.principal
    side_x, side_y = np.clip(x / z, *lens.x_limits), np.clip(y / z, *lens.y_limits)
    zero = np.zeros_like(z)
    jacobian = np.stack(
        [np.stack([fx / z, zero, -fx * side_x / z], -1), np.stack([zero, fy / z, -fy * side_y / z], -1)], axis=1
    )
    scales = np.minimum(np.exp(gaussians.log_scales[ids].astype(np.float64)), LARGEST_DEVIATION_M)
    axes = jacobian @ lens.rotation @ (quats_to_rotations(gaussians.quats[ids]) * scales[:, None, :])
    p, q = axes[:, 0], axes[:, 1]
    xx, xy, yy = (p * p).sum(-1), (p * q).sum(-1), (q * q).sum(-1)
    # Squared 2 x 2 minors: xx * yy - xy^2 would cancel for needles even in float64.
    sharp = (np.cross(p, q) ** 2).sum(-1)
    det = sharp + LOW_PASS_PX2 * (xx + yy) + LOW_PASS_PX2**2
    opacities = all_opacities[ids]
    if antialias:
        opacities = opacities * np.sqrt(np.maximum(ANTIALIAS_FLOOR, sharp / det))
    return Projection(
        ids=ids,
        centers=np.stack([fx * x / z + cx, fy * y / z + cy], axis=-1),
        conics=np.stack([(yy + LOW_PASS_PX2) / det, -xy / det, (xx + LOW_PASS_PX2) / det], axis=-1),
        opacities=opacities,
        depths=depths32[ids].astype(np.float64),
    )


def layers(
    projection: Projection, camera: Camera, quality: RenderQuality = EXACT
) -> Iterator[tuple[int, Float64[np.ndarray, "H W"], Float64[np.ndarray, "H W"]]]:
    """Yield, nearest first, each Gaussian's place in the projection, its weight T * alpha and the T it leaves."""
    alpha_min, t_stop = float(np.float32(quality.alpha_min)), float(np.float32(quality.transmittance_stop))
    shape = (camera.height, camera.width)
    pixel_x, pixel_y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    transmittance, stopped = np.ones(shape), np.zeros(shape, bool)
    for k in range(len(projection.ids)):
        dx, dy = pixel_x - projection.centers[k, 0], pixel_y - projection.centers[k, 1]
        xx, xy, yy = projection.conics[k]
        power = -0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy
        alpha = np.minimum(ALPHA_CAP, projection.opacities[k] * np.exp(np.minimum(power, 0.0)))
        counts = (alpha >= alpha_min) & ~stopped
        after = transmittance * (1.0 - alpha)
        stopped |= counts & (after < T_MIN)
        counts &= ~stopped
        weight = np.where(counts, transmittance * alpha, 0.0)
        transmittance = np.where(counts, after, transmittance)
        stopped |= transmittance < t_stop
        yield k, weight, transmittance


def render_float64(
    gaussians: Gaussians,
    camera: Camera,
    outputs: frozenset[str],
    *,
    background: tuple[float, float, float],
    near: float,
    sh_degree: int,
    antialias: bool,
    quality: RenderQuality = EXACT,
) -> Rendering:
    """Return the outputs of one view; arguments are as in `render_frame`, already checked."""
    projection = project_float64(gaussians, camera, near, antialias, min_opacity=quality.min_opacity)
    colors = sh_colors(gaussians, Lens.of(camera).center, projection.ids, sh_degree)
    shape = (camera.height, camera.width)
    transmittance, color, depth_sum = np.ones(shape), np.zeros((*shape, 3)), np.zeros(shape)
    dominant, best = np.full(shape, -1, np.int32), np.zeros(shape)
    for k, weight, after in layers(projection, camera, quality):
        color += weight[..., None] * colors[k]
        depth_sum += weight * projection.depths[k]
        wins = weight > best
        dominant[wins], best[wins] = projection.ids[k], weight[wins]
        transmittance = after
    alpha = 1.0 - transmittance
    depth = np.divide(depth_sum, alpha, out=np.zeros(shape), where=alpha > 0)
    color += transmittance[..., None] * np.asarray(background, np.float64)
    return Rendering(
        color=color.astype(np.float32) if "color" in outputs else None,
        depth=depth.astype(np.float32) if "depth" in outputs else None,
        alpha=alpha.astype(np.float32) if "alpha" in outputs else None,
        dominant=dominant if "dominant" in outputs else None,
        dominant_weight=best.astype(np.float32) if "dominant" in outputs else None,
    )


def sh_colors(
    gaussians: Gaussians, center: Float64[np.ndarray, "3"], ids: Int64[np.ndarray, "n"], degree: int
) -> Float64[np.ndarray, "n 3"]:
    """Return linear RGB, max(0, sum + 0.5), of Gaussians seen from `center` (metres)."""
    direction = gaussians.means[ids].astype(np.float64) - center
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    harmonics = sh_basis(direction, degree)
    coefficients = gaussians.sh[ids, : harmonics.shape[1]].astype(np.float64)
    return np.maximum(0.0, np.einsum("nk,nkc->nc", harmonics, coefficients) + 0.5)


def sh_basis(directions: Float64[np.ndarray, "n 3"], degree: int) -> Float64[np.ndarray, "n K"]:
    """Return the real spherical harmonics up to `degree` (0 to 3) with the signs 3DGS files use."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    values = [
        np.full_like(x, 0.28209479177387814),
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return np.stack(values[: (degree + 1) ** 2], axis=-1)
