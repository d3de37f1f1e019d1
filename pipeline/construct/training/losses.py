"""What training lowers: L1 and D-SSIM on colour, L1 on inverse depth; on a CPU with compiled gradients.

    L = (1 - lambda) mean|x - y| + lambda (1 - SSIM(x, y)) + w(t) mean(mask |d - d_measured|)

3DGS (Kerbl et al. 2023, equation 7) and its hierarchical follow-up (Kerbl et al. 2024), which the paper cites for the
depth term. SSIM by torch takes longer than rendering a frame does here, so that the CPU has kernels of its own.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from pipeline.construct.training.ssim_kernels import C1, C2, RADIUS, SIGMA, ssim_backward, ssim_forward
from pipeline.render.threads import run_each, split
from pipeline.render.workspace import WORKSPACE
from schemas.errors import InputError

STRIP = 32
"""Rows a thread takes at once: ten more are blurred with them, and the numbers of a strip stay in the cache."""


def photometric_loss(
    color: Float[torch.Tensor, "H W 3"],
    photo: Float[torch.Tensor, "h w 3"],
    dssim_weight: float = 0.2,
    *,
    threads: int = 1,
) -> Float[torch.Tensor, ""]:
    """Return (1 - weight) L1 + weight (1 - SSIM), differentiable by `color`; the same bits at any thread count.

    Args:
        color: The rendering, not clamped.
        photo: The photograph, 0 to 1.
        dssim_weight: lambda, 0 to 1.
        threads: Threads of the compiled SSIM.

    Raises:
        InputError: The images differ in size.
    """
    if color.shape != photo.shape:
        raise InputError("photometric loss", field="color", expected=str(tuple(photo.shape)), found=tuple(color.shape))
    if color.device.type == "cpu" and color.dtype == torch.float32:
        return _CompiledLoss.apply(color, photo, dssim_weight, threads)
    l1 = (color - photo).abs().mean()
    return (1.0 - dssim_weight) * l1 + dssim_weight * (1.0 - torch_ssim(color, photo))


def torch_ssim(color: Float[torch.Tensor, "H W 3"], photo: Float[torch.Tensor, "H W 3"]) -> Float[torch.Tensor, ""]:
    """Return SSIM averaged over pixels and channels, by torch's own operations: any device and type."""
    x, y = (image.permute(2, 0, 1)[:, None] for image in (color, photo))
    taps = _taps(str(color.device), color.dtype)

    def blur(image: torch.Tensor) -> torch.Tensor:
        across = torch.nn.functional.conv2d(image, taps[None, None, None, :], padding=(0, RADIUS))
        return torch.nn.functional.conv2d(across, taps[None, None, :, None], padding=(RADIUS, 0))

    c1, c2 = float(C1), float(C2)
    mu_x, mu_y = blur(x), blur(y)
    spread_x, spread_y, shared = blur(x * x) - mu_x**2, blur(y * y) - mu_y**2, blur(x * y) - mu_x * mu_y
    top = (2 * mu_x * mu_y + c1) * (2 * shared + c2)
    return (top / ((mu_x**2 + mu_y**2 + c1) * (spread_x + spread_y + c2))).mean()


def inverse_depth_loss(
    rendered: Float[torch.Tensor, "H W"], measured: Float[torch.Tensor, "H W"]
) -> Float[torch.Tensor, ""]:
    """Return the mean over all pixels of |rendered - measured| where there is a measure, 1/metres.

    Args:
        rendered: Sum of w / z over the Gaussians of a pixel.
        measured: 1 / depth; 0 where nothing was measured.
    """
    return ((rendered - measured) * (measured > 0)).abs().mean()


def depth_weight(share: float, first: float = 1.0, last: float = 0.01) -> float:
    """Return w(t), log-linear from `first` to `last` as the share of training that is done goes from 0 to 1."""
    return math.exp(math.log(first) + min(max(share, 0.0), 1.0) * (math.log(last) - math.log(first)))


class _CompiledLoss(torch.autograd.Function):  # type: ignore[misc]
    """The loss is the end of the graph, so that its gradient is worked out with it and only scaled afterwards."""

    @staticmethod
    def forward(
        context: Any, color: torch.Tensor, photo: torch.Tensor, dssim_weight: float, threads: int
    ) -> torch.Tensor:
        height, width, _ = color.shape
        x, y = (image.detach().contiguous().numpy().reshape(-1) for image in (color, photo))
        maps = [WORKSPACE.array(f"ssim {name}", len(x), np.float32) for name in ("mean", "square", "product")]
        strips = split(height, -(-height // STRIP))
        sums = np.empty((len(strips), 2))

        def forward(k: int) -> None:
            ssim_forward(*strips[k], height, 3 * width, x, y, *maps, sums, k)

        run_each(forward, len(strips), threads)
        if context.needs_input_grad[0]:
            gradient = np.empty(len(x), np.float32)
            l1_scale, ssim_scale = np.float32((1.0 - dssim_weight) / len(x)), np.float32(-dssim_weight / len(x))

            def backward(k: int) -> None:
                ssim_backward(*strips[k], height, 3 * width, x, y, *maps, l1_scale, ssim_scale, gradient)

            run_each(backward, len(strips), threads)
            context.save_for_backward(torch.from_numpy(gradient.reshape(color.shape)))
        l1, similarity = sums.sum(axis=0) / len(x)
        return torch.tensor((1.0 - dssim_weight) * l1 + dssim_weight * (1.0 - similarity), dtype=torch.float32)

    @staticmethod
    def backward(context: Any, by_value: torch.Tensor) -> tuple[torch.Tensor, None, None, None]:
        (gradient,) = context.saved_tensors
        return by_value * gradient, None, None, None


@lru_cache(maxsize=4)
def _taps(device: str, dtype: torch.dtype) -> torch.Tensor:
    offsets = torch.arange(-RADIUS, RADIUS + 1, dtype=torch.float64)
    taps = torch.exp(-0.5 * (offsets / SIGMA) ** 2)
    return (taps / taps.sum()).to(dtype).to(device)
