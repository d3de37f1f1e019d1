"""gsplat's CUDA rasteriser behind the names of `rasterizer`: the same images and gradients for parameters on a GPU.

Needs the extra `gpu` and a CUDA device; it is never chosen by what happens to be installed. Its pixels differ from the
CPU's as the two rasterisers do: gsplat caps alpha at 0.999 in some versions and cuts footprints at 3.33 standard
deviations. Gradients take the same things as constant.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from pipeline.construct.training.rasterizer import OUTPUTS, ScreenGradients, SeenGradients, checked_outputs, tile_pixels
from pipeline.geometry import Camera
from schemas.errors import InputError

LOW_PASS_PX2 = 0.3
"""Variance added to both image axes, as on the CPU."""


@dataclass(slots=True)
class GpuRaster:
    """Images of one view, with the fields and methods of `rasterizer.Raster`."""

    color: Float[Tensor, "H W 3"] | None
    """Linear sum of w c plus the background behind it."""
    alpha: Float[Tensor, "H W"] | None
    """Sum of the weights."""
    depth: Float[Tensor, "H W"] | None
    """Sum of w z, metres."""
    inverse_depth: Float[Tensor, "H W"] | None
    """Sum of w / z, per metre."""
    seen: Int64[Tensor, "n"]
    """Gaussians whose footprint touches the image, rising."""
    radius_px: Float[Tensor, "n"]
    """gsplat's half extent along the longer image axis, pixels."""
    screen: ScreenGradients = field(default_factory=ScreenGradients)
    """Filled in by `seen_gradients`."""
    _graph: Any = None

    def seen_gradients(self) -> SeenGradients:
        """Return the parameters' gradients, once `loss.backward()` has reached the images; can be asked once.

        Raises:
            ValueError: Asked before, or no loss has reached the images.
        """
        if self._graph is None:
            raise ValueError("this raster's memory was given back by `seen_gradients`, which can be asked once")
        parameters, means_px, outputs, kept, half_size, used = self._graph
        pulls = {name: getattr(self, name).grad for name in outputs if getattr(self, name).grad is not None}
        if not pulls:
            raise ValueError("no gradient has reached this raster's images: call `backward` on a loss of them first")
        if kept is not None:
            pulls = {name: pull * (kept[..., None] if pull.ndim == 3 else kept) for name, pull in pulls.items()}
        *rows, at_screen = torch.autograd.grad(
            [outputs[name] for name in pulls], [*parameters, means_px], list(pulls.values()), materialize_grads=True
        )
        self._graph = None
        means, quats, log_scales, opacity_logits, sh = (gradient[self.seen] for gradient in rows)
        self.screen.norm = (at_screen[0, self.seen] * half_size).norm(dim=1)
        return SeenGradients(
            self.seen, means, quats, log_scales, opacity_logits, sh[:, :used].contiguous(), self.screen.norm
        )


def rasterize_seen(
    means: Float[Tensor, "M 3"],
    quats: Float[Tensor, "M 4"],
    log_scales: Float[Tensor, "M 3"],
    opacity_logits: Float[Tensor, "M"],
    sh: Float[Tensor, "M K 3"],
    camera: Camera,
    *,
    sh_degree: int | None = None,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near: float = 0.2,
    outputs: Iterable[str] = ("color", "alpha", "inverse_depth"),
    tiles: Bool[np.ndarray, "rows columns"] | None = None,
    threads: int | None = None,
) -> GpuRaster:
    """Return images that are leaves of a graph, as `rasterizer.rasterize_seen` does; `threads` is ignored.

    Depth and inverse depth are drawn as two more channels beside the colours: gsplat blends any number of them.

    Raises:
        InputError: gsplat is not installed, or an argument is not as described.
    """
    try:
        import gsplat
    except ImportError as error:
        raise InputError(
            "rasterize", field="device", expected="the extra `gpu` installed for cuda", found="no gsplat"
        ) from error
    wanted = checked_outputs(outputs)
    device, dtype = means.device, means.dtype
    parameters = [p.detach().requires_grad_() for p in (means, quats, log_scales, opacity_logits, sh)]
    means, quats, log_scales, opacity_logits, sh = parameters
    degree = int(np.sqrt(sh.shape[1])) - 1 if sh_degree is None else sh_degree
    pose = torch.eye(4, dtype=dtype, device=device)
    pose[:3] = torch.tensor(np.array(camera.world_to_camera), dtype=dtype)
    center = torch.tensor(camera.center, dtype=dtype, device=device)
    colors = torch.clamp_min(gsplat.spherical_harmonics(degree, means - center, sh) + 0.5, 0.0)
    z = means @ pose[2, :3] + pose[2, 3]
    inverse_z = 1.0 / torch.where(z > near, z, torch.ones_like(z))
    images, alphas, meta = gsplat.rasterization(
        means,
        quats,
        log_scales.exp(),
        torch.sigmoid(opacity_logits),
        torch.cat([colors, z[:, None], inverse_z[:, None]], dim=1),
        pose[None],
        torch.tensor(np.array(camera.K), dtype=dtype, device=device)[None],
        camera.width,
        camera.height,
        near_plane=near,
        eps2d=LOW_PASS_PX2,
        packed=False,
        backgrounds=torch.tensor([[*background, 0.0, 0.0]], dtype=dtype, device=device),
    )
    all_outputs = {
        "color": images[0, ..., :3],
        "alpha": alphas[0, ..., 0],
        "depth": images[0, ..., 3],
        "inverse_depth": images[0, ..., 4],
    }
    kept_outputs = {name: all_outputs[name] for name in wanted}
    leaves = {name: image.detach().requires_grad_() for name, image in kept_outputs.items()}
    radii = meta["radii"][0]
    radii = radii.amax(-1) if radii.ndim == 2 else radii
    seen = torch.nonzero(radii > 0)[:, 0]
    kept = None if tiles is None else torch.from_numpy(tile_pixels(tiles, camera)).to(device)
    half_size = torch.tensor([camera.width / 2, camera.height / 2], dtype=dtype, device=device)
    graph = (parameters, meta["means2d"], kept_outputs, kept, half_size, (degree + 1) ** 2)
    color, alpha, depth, inverse_depth = (leaves.get(name) for name in OUTPUTS)
    return GpuRaster(color, alpha, depth, inverse_depth, seen, radii[seen].to(dtype), _graph=graph)
