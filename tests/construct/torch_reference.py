"""The renderer as one dense PyTorch expression in float64: an independent gradient for everything it can differentiate.

Every Gaussian meets every pixel at once, so it is for tiny scenes. Formulas are written out anew from the semantics in
docs/conventions.md; nothing is shared with the kernels. Autograd sees the image as a smooth function of the raw
parameters where the set of contributions stays as it is: order, cut-off, stop and near plane are taken as constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pipeline.geometry import Camera


@dataclass(frozen=True, slots=True)
class Images:
    """What the kernels return, in the dtype of the parameters."""

    color: Tensor
    alpha: Tensor
    depth: Tensor
    inverse_depth: Tensor
    contributions: Tensor
    """Bool, Gaussian x pixel: who adds to which pixel (rows nearest first); a check that a step changed nothing."""
    means_px: Tensor
    """Projected means of the Gaussians in compositing order, a node of the graph."""
    ids: Tensor
    """Gaussians in compositing order."""


def render_dense(
    means: Tensor,
    quats: Tensor,
    log_scales: Tensor,
    opacity_logits: Tensor,
    sh: Tensor,
    camera: Camera,
    *,
    sh_degree: int | None = None,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near: float = 0.2,
) -> Images:
    """Return the images of one view; the arguments are those of `rasterize`, in any floating dtype."""
    center = _center(camera, means.dtype)
    blended = blend_dense(means, quats, log_scales.exp(), torch.sigmoid(opacity_logits), camera, near=near)
    degree = int(np.sqrt(sh.shape[1])) - 1 if sh_degree is None else sh_degree
    colors = torch.clamp(harmonics_dense(degree, means[blended.ids] - center, sh[blended.ids]) + 0.5, min=0)
    weights, size = blended.weights, (camera.height, camera.width)
    remaining = 1 - weights.sum(0)
    color = weights.T @ colors + remaining[:, None] * torch.tensor(background, dtype=means.dtype)
    return Images(
        color=color.reshape(*size, 3),
        alpha=weights.sum(0).reshape(size),
        depth=(weights * blended.depths[:, None]).sum(0).reshape(size),
        inverse_depth=(weights / blended.depths[:, None]).sum(0).reshape(size),
        contributions=weights > 0,
        means_px=blended.means_px,
        ids=blended.ids,
    )


@dataclass(frozen=True, slots=True)
class Blended:
    """Who weighs how much where; Gaussians in compositing order."""

    ids: Tensor
    weights: Tensor
    """Gaussian x pixel."""
    means_px: Tensor
    depths: Tensor


def blend_dense(
    means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, camera: Camera, *, near: float
) -> Blended:
    """Return the weights of activated Gaussians at every pixel."""
    dtype = means.dtype
    pose, K = (torch.tensor(np.array(a), dtype=dtype) for a in (camera.world_to_camera, camera.K))
    rotation, center = pose[:, :3], _center(camera, dtype)
    # As the rasteriser: depths are compared as float32.
    with torch.no_grad():
        depths32 = ((means - center) @ rotation.T)[:, 2].to(torch.float32)
        order = torch.argsort(depths32, stable=True)
        ids = order[depths32[order] > np.float32(near)]
    x, y, z = ((means[ids] - center) @ rotation.T).unbind(-1)
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    means_px = torch.stack([fx * x / z + cx, fy * y / z + cy], -1)

    # J at the clamped direction: tangents reach 0.3 half-widths beyond the image's sides.
    margin_x, margin_y = 0.3 * camera.width / (2 * fx), 0.3 * camera.height / (2 * fy)
    side_x = torch.clamp(x / z, -cx / fx - margin_x, (camera.width - cx) / fx + margin_x)
    side_y = torch.clamp(y / z, -cy / fy - margin_y, (camera.height - cy) / fy + margin_y)
    nothing = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([fx / z, nothing, -fx * side_x / z], -1), torch.stack([nothing, fy / z, -fy * side_y / z], -1)], -2
    )
    flat = jacobian @ rotation @ (_rotations(quats[ids]) * scales[ids][:, None, :])
    covariance = flat @ flat.mT + 0.3 * torch.eye(2, dtype=dtype)
    (a, b), (_, c) = (row.unbind(-1) for row in covariance.unbind(-2))
    determinant = a * c - b * b

    pixel_y, pixel_x = torch.meshgrid(
        torch.arange(camera.height, dtype=dtype) + 0.5, torch.arange(camera.width, dtype=dtype) + 0.5, indexing="ij"
    )
    dx = pixel_x.reshape(1, -1) - means_px[:, :1]
    dy = pixel_y.reshape(1, -1) - means_px[:, 1:]
    q = (c[:, None] * dx**2 - 2 * b[:, None] * dx * dy + a[:, None] * dy**2) / determinant[:, None]
    uncut = opacities[ids][:, None] * torch.exp(-q / 2)
    alpha = torch.clamp(uncut, max=float(np.float32(0.99)))
    alpha = torch.where(uncut >= float(np.float32(1 / 255)), alpha, torch.zeros_like(alpha))
    with torch.no_grad():
        # Transmittance only falls: the first contribution that would leave too little ends the pixel, and is not added.
        alive = torch.cumprod(1 - alpha, dim=0) >= float(np.float32(1e-4))
    alpha = torch.where(alive, alpha, torch.zeros_like(alpha))
    through = torch.cumprod(1 - alpha, dim=0)
    before = torch.cat([torch.ones_like(through[:1]), through])[:-1]
    return Blended(ids, alpha * before, means_px, z)


def _center(camera: Camera, dtype: torch.dtype) -> Tensor:
    pose = torch.tensor(np.array(camera.world_to_camera), dtype=dtype)
    return -torch.linalg.solve(pose[:, :3], pose[:, 3])


def _rotations(quats: Tensor) -> Tensor:
    """Rotation matrices of unnormalised wxyz quaternions, column by column as images of the axes."""
    w, v = quats[:, :1] / quats.norm(dim=1, keepdim=True), quats[:, 1:] / quats.norm(dim=1, keepdim=True)
    columns = []
    for axis in torch.eye(3, dtype=quats.dtype):
        e = axis.expand_as(v)
        t = 2 * torch.linalg.cross(v, e)
        columns.append(e + w * t + torch.linalg.cross(v, t))
    return torch.stack(columns, -1)


def harmonics_dense(degree: int, offsets: Tensor, sh: Tensor) -> Tensor:
    """Sum of harmonics along the ray, their factors from their definitions and not from a table."""
    x, y, z = (offsets / offsets.norm(dim=1, keepdim=True)).unbind(-1)
    pi, one = np.pi, torch.ones_like(x)
    harmonics = [one * np.sqrt(1 / (4 * pi))]
    if degree > 0:
        k = np.sqrt(3 / (4 * pi))
        harmonics += [-k * y, k * z, -k * x]
    if degree > 1:
        k = np.sqrt(15 / (4 * pi))
        harmonics += [k * x * y, -k * y * z, np.sqrt(5 / (16 * pi)) * (3 * z**2 - 1), -k * x * z, k / 2 * (x**2 - y**2)]
    if degree > 2:
        k3, k2, k1, k0 = (
            np.sqrt(35 / (32 * pi)),
            np.sqrt(105 / (4 * pi)),
            np.sqrt(21 / (32 * pi)),
            np.sqrt(7 / (16 * pi)),
        )
        harmonics += [
            -k3 * y * (3 * x**2 - y**2),
            k2 * x * y * z,
            -k1 * y * (5 * z**2 - 1),
            k0 * z * (5 * z**2 - 3),
            -k1 * x * (5 * z**2 - 1),
            k2 / 2 * z * (x**2 - y**2),
            -k3 * x * (x**2 - 3 * y**2),
        ]
    basis = torch.stack(harmonics, -1)
    return torch.einsum("nk,nkc->nc", basis, sh[:, : basis.shape[1]])
