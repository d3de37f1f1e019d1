"""The CPU rasteriser as PyTorch sees it: images with a gradient with respect to the raw parameters of Gaussians.

`rasterize` is an ordinary differentiable function. A trainer that touches only the Gaussians an image shows uses
`rasterize_seen`: its images are leaves, and after `backward` it is asked for the gradients of the n Gaussians seen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from pipeline.geometry import Camera
from pipeline.render.backward import Drawing, RawGaussians, RawGradients, draw
from pipeline.render.window import TILE
from pipeline.scene.gaussians import SH_COUNTS
from schemas.errors import InputError

OUTPUTS = ("color", "alpha", "depth", "inverse_depth")
"""Images a raster can hold."""


@dataclass(slots=True)
class ScreenGradients:
    """What densification reads: how the loss pulls at the projected means; filled in by the backward pass."""

    norm: Float[Tensor, "n"] | None = None
    """Length of d loss / d (projected mean), in 3DGS's units: both image axes run from -1 to 1."""


@dataclass(frozen=True, slots=True)
class SeenGradients:
    """Gradients with respect to the raw parameters of the n Gaussians an image shows; all others are exactly 0."""

    ids: Int64[Tensor, "n"]
    """Indices among the M Gaussians, rising."""
    means: Float[Tensor, "n 3"]
    """Per metre."""
    quats: Float[Tensor, "n 4"]
    """With respect to the unnormalised quaternion: always at a right angle to it."""
    log_scales: Float[Tensor, "n 3"]
    """Per unit of the natural logarithm."""
    opacity_logits: Float[Tensor, "n"]
    """Before the sigmoid."""
    sh: Float[Tensor, "n U 3"]
    """The U coefficients of the degree in use, 1, 4, 9 or 16; those beyond have none."""
    screen_norm: Float[Tensor, "n"]
    """See `ScreenGradients.norm`."""


@dataclass(slots=True)
class Raster:
    """Images of one view; an output that was not asked for is None."""

    color: Float[Tensor, "H W 3"] | None
    """Linear sum of w c plus the background behind it."""
    alpha: Float[Tensor, "H W"] | None
    """Sum of the weights, 0 to 1."""
    depth: Float[Tensor, "H W"] | None
    """Sum of w z, metres: not divided by alpha."""
    inverse_depth: Float[Tensor, "H W"] | None
    """Sum of w / z, per metre: not divided by alpha."""
    seen: Int64[Tensor, "n"]
    """Gaussians this image shows, rising: those that touch a tile which was not yet opaque in front of them."""
    screen: ScreenGradients = field(default_factory=ScreenGradients)
    """Filled in by the backward pass."""
    _drawing: Drawing | None = None
    _tiles: Bool[np.ndarray, "rows columns"] | None = None

    @property
    def radius_px(self) -> Float[Tensor, "n"]:
        """Three standard deviations along the projected ellipse's longer axis, low-pass included, pixels.

        Raises:
            ValueError: `seen_gradients` was called before.
        """
        return torch.from_numpy(self._kept().radius_px)

    def seen_gradients(self) -> SeenGradients:
        """Return the parameters' gradients, once `loss.backward()` has reached the images of `rasterize_seen`.

        They can be asked for once: the drawing's memory is then free for the next.

        Raises:
            ValueError: The raster comes from `rasterize`, was asked before, or no loss has reached it.
        """
        drawing = self._kept()
        images = [getattr(self, name) for name in OUTPUTS]
        reached = [image.grad if image is not None and image.is_leaf else None for image in images]
        if all(gradient is None for gradient in reached):
            raise ValueError("no gradient has reached this raster's images: call `backward` on a loss of them first")
        found = _pulled_back(drawing, reached, self._tiles)
        drawing.release()
        self._drawing = None
        rows = {name: torch.from_numpy(getattr(found, name)) for name in RawGradients.__slots__}
        self.screen.norm = rows["screen_norm"]
        return SeenGradients(ids=self.seen, **rows)

    def _kept(self) -> Drawing:
        if self._drawing is None:
            raise ValueError("this raster's memory was given back by `seen_gradients`, which can be asked once")
        return self._drawing


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
) -> Raster:
    """Return images that are leaves of a graph: call `backward` on a loss of them, then `raster.seen_gradients()`.

    The parameters need no `requires_grad`, and nothing of the size of all M Gaussians is made for them. They must not
    change between this call and `seen_gradients`. Arguments are those of `rasterize`.

    Raises:
        InputError: An argument is not as described.
    """
    wanted = checked_outputs(outputs)
    drawing = _draw(
        (means, quats, log_scales, opacity_logits, sh), camera, sh_degree, background, near, wanted, threads
    )
    checked_tiles(tiles, camera)
    leaves = {name: torch.from_numpy(getattr(drawing, name)).requires_grad_() for name in wanted}
    return _raster(drawing, leaves, tiles)


def rasterize(
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
) -> Raster:
    """Return images of the Gaussians with a gradient with respect to their raw parameters (float32, CPU).

    The pixels are those of `pipeline.render.render`, to float32 rounding; images and gradients have the same bits at
    any thread count.

    Args:
        means: Centres, metres.
        quats: wxyz, any non-zero norm.
        log_scales: Natural logarithm of the standard deviations, metres.
        opacity_logits: Before the sigmoid.
        sh: Spherical harmonics, K = 1, 4, 9 or 16.
        camera: Lens, pose and image size.
        sh_degree: Highest degree used; None for what `sh` holds.
        background: Linear RGB seen where transmittance is left.
        near: Gaussians at z <= near are left out, metres.
        outputs: Which images are wanted, of `OUTPUTS`.
        tiles: 16 x 16 pixel tiles whose gradient is wanted; that of the others is dropped. None for all. Tiles whose
            images have no gradient at all are found and skipped in any case.
        threads: Threads inside this frame; None for PyTorch's number.

    Raises:
        InputError: An argument is not as described.
    """
    wanted = checked_outputs(outputs)
    checked_tiles(tiles, camera)
    screen = ScreenGradients()
    parameters = (means, quats, log_scales, opacity_logits, sh)
    drawing = _draw(parameters, camera, sh_degree, background, near, wanted, threads)
    images = _Rasterize.apply(drawing, tiles, screen, *parameters)
    named = {name: image for name, image in zip(OUTPUTS, images, strict=True) if name in wanted}
    raster = _raster(drawing, named, tiles)
    raster.screen = screen
    return raster


class _Rasterize(torch.autograd.Function):  # type: ignore[misc]
    """The images of a drawing, and the way back to all M rows of each parameter."""

    @staticmethod
    def forward(
        context: Any, drawing: Drawing, tiles: Any, screen: ScreenGradients, *parameters: Tensor
    ) -> tuple[Tensor | None, ...]:
        context.drawing, context.tiles, context.screen = drawing, tiles, screen
        context.save_for_backward(*parameters)
        context.set_materialize_grads(False)
        images = (getattr(drawing, name) for name in OUTPUTS)
        return tuple(None if image is None else torch.from_numpy(image) for image in images)

    @staticmethod
    def backward(context: Any, *gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        parameters = context.saved_tensors  # an error here if one was changed in place since it was drawn
        found = _pulled_back(context.drawing, gradients, context.tiles)
        context.screen.norm = torch.from_numpy(found.screen_norm)
        ids = torch.from_numpy(context.drawing.ids).long()
        rows = (getattr(found, name) for name in RawGradients.__slots__)
        dense = [torch.zeros_like(parameter) for parameter in parameters]
        for whole, row in zip(dense, rows, strict=False):
            part = whole[:, : row.shape[1]] if whole.ndim == 3 else whole
            part.index_copy_(0, ids, torch.from_numpy(row))
        return None, None, None, *dense


def _raster(drawing: Drawing, images: dict[str, Tensor], tiles: Any) -> Raster:
    color, alpha, depth, inverse_depth = (images.get(name) for name in OUTPUTS)
    seen = torch.from_numpy(drawing.ids).long()
    return Raster(color, alpha, depth, inverse_depth, seen, _drawing=drawing, _tiles=tiles)


def _draw(
    parameters: tuple[Tensor, ...],
    camera: Camera,
    sh_degree: int | None,
    background: tuple[float, float, float],
    near: float,
    outputs: tuple[str, ...],
    threads: int | None,
) -> Drawing:
    count, sh_count = len(parameters[0]), parameters[4].shape[1] if parameters[4].ndim == 3 else -1
    shapes = ((count, 3), (count, 4), (count, 3), (count,), (count, sh_count, 3))
    for name, tensor, shape in zip(RawGaussians.__slots__, parameters, shapes, strict=True):
        if tuple(tensor.shape) != shape or (name == "sh" and sh_count not in SH_COUNTS.values()):
            raise InputError("rasterize", field=name, expected=f"shape {shape}", found=tuple(tensor.shape))
        if tensor.dtype != torch.float32 or tensor.device.type != "cpu":
            raise InputError(
                "rasterize", field=name, expected="float32 on the CPU", found=f"{tensor.dtype} on {tensor.device}"
            )
    stored = int(np.sqrt(sh_count)) - 1
    degree = stored if sh_degree is None else sh_degree
    if not 0 <= degree <= stored:
        raise InputError("rasterize", field="sh_degree", expected=f"0 to {stored}, as stored", found=sh_degree)
    if not (np.isfinite(near) and near >= 0):
        raise InputError("rasterize", field="near", expected="a distance of 0 m or more", found=near)
    if threads is not None and threads < 1:
        raise InputError("rasterize", field="threads", expected="1 or more", found=threads)
    return draw(
        RawGaussians(*(tensor.detach().contiguous().numpy() for tensor in parameters)),
        camera,
        background=background,
        near=near,
        sh_degree=degree,
        depth="depth" in outputs,
        inverse_depth="inverse_depth" in outputs,
        threads=torch.get_num_threads() if threads is None else threads,
    )


def _pulled_back(drawing: Drawing, gradients: Any, tiles: Any) -> RawGradients:
    color, alpha, depth, inverse_depth = (None if g is None else g.detach().numpy() for g in gradients)
    return drawing.gradients(
        np.zeros_like(drawing.color) if color is None else color, alpha, depth, inverse_depth, tiles=tiles
    )


def checked_outputs(outputs: Iterable[str]) -> tuple[str, ...]:
    """Return the outputs; InputError where one is unknown or none is given."""
    wanted = () if isinstance(outputs, str) else tuple(outputs)
    if not wanted or not set(wanted) <= set(OUTPUTS):
        raise InputError("rasterize", field="outputs", expected=f"one or more of {OUTPUTS}", found=outputs)
    return wanted


def checked_tiles(
    tiles: Bool[np.ndarray, "rows columns"] | None, camera: Camera
) -> Bool[np.ndarray, "rows columns"] | None:
    """Return the tiles; InputError unless they are None or a mask of the camera's."""
    shape = (-(-camera.height // TILE), -(-camera.width // TILE))
    if tiles is not None and (tiles.shape != shape or tiles.dtype != np.bool_):
        found = f"{tiles.dtype} {tiles.shape}"
        raise InputError("rasterize", field="tiles", expected=f"bool, rows x columns {shape}", found=found)
    return tiles


def tile_pixels(tiles: Bool[np.ndarray, "rows columns"], camera: Camera) -> Bool[np.ndarray, "H W"]:
    """Return the pixels of these 16 x 16 tiles of the camera's image; InputError where the mask is not its size."""
    checked_tiles(tiles, camera)
    return tiles.repeat(TILE, axis=0).repeat(TILE, axis=1)[: camera.height, : camera.width]
