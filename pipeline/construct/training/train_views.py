"""The photographs training looks at, at the scale it asks for, with measured inverse depth in the same pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float16, UInt8
from PIL import Image

from pipeline.construct.training.depth_warp import inverse_depth_in
from pipeline.geometry import Camera
from pipeline.scene.captures import Frame
from schemas.errors import InputError

SMALLEST_EXTENT_M = 0.1
"""Extent of a capture that hardly moves: positions must be free to move all the same."""


@dataclass(frozen=True, slots=True)
class TrainView:
    """What one step compares with."""

    camera: Camera
    """Lens, pose and size at this scale."""
    photo: Float[torch.Tensor, "H W 3"]
    """Photograph, 0 to 1."""
    inverse_depth: Float[torch.Tensor, "H W"] | None
    """1/metres, 0 where nothing was measured; None for a frame without depth."""


class TrainViews:
    """Frames read once: 8-bit photographs and 16-bit inverse depth, 5 bytes a pixel, and again at the scale in use.

    Args:
        frames: Posed photographs, with or without depth.
        longest_side: Photographs with a longer side are scaled down to it, pixels.
        with_depth: Whether depth is read.
        device: Where the tensors go.

    Raises:
        InputError: There is no frame, or an image cannot be read.
    """

    def __init__(self, frames: Sequence[Frame], longest_side: int, *, with_depth: bool, device: str = "cpu") -> None:
        if not frames:
            raise InputError("training", field="frames", expected="at least one photograph", found="none")
        self._device = device
        self._originals = [_read(frame, longest_side, with_depth) for frame in frames]
        self._scale, self._scaled = 1.0, dict(enumerate(self._originals))

    def __len__(self) -> int:
        return len(self._originals)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, at the largest size used."""
        return tuple(original.camera for original in self._originals)

    def view(self, index: int, scale: float) -> TrainView:
        """Return a frame with each side `scale` times as long."""
        if scale != self._scale:
            self._scale, self._scaled = scale, dict(enumerate(self._originals)) if scale == 1.0 else {}
        if index not in self._scaled:
            self._scaled[index] = self._originals[index].scaled(scale)
        return self._scaled[index].view(self._device)


@dataclass(frozen=True, slots=True)
class _Stored:
    camera: Camera
    photo: UInt8[np.ndarray, "H W 3"]
    inverse_depth: Float16[np.ndarray, "H W"] | None
    """Half precision is 1 mm at 2 m: less than a depth camera's noise."""

    def scaled(self, scale: float) -> _Stored:
        width, height = (max(1, round(side * scale)) for side in (self.camera.width, self.camera.height))
        photo = np.asarray(Image.fromarray(self.photo).resize((width, height), Image.Resampling.BOX))
        inverse = None if self.inverse_depth is None else _shrunk(self.inverse_depth, width, height)
        return _Stored(self.camera.resized(width, height), photo, inverse)

    def view(self, device: str) -> TrainView:
        photo = torch.from_numpy(self.photo.astype(np.float32) / np.float32(255.0)).to(device)
        depth = None if self.inverse_depth is None else torch.from_numpy(self.inverse_depth.astype(np.float32))
        return TrainView(self.camera, photo, None if depth is None else depth.to(device))


def extent_of(cameras: Sequence[Camera]) -> float:
    """Return 1.1 times the largest distance of a camera from their mean, metres: the unit of 3DGS's positions."""
    centers = np.array([camera.center for camera in cameras])
    return max(SMALLEST_EXTENT_M, 1.1 * float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max()))


def _read(frame: Frame, longest_side: int, with_depth: bool) -> _Stored:
    inverse = None
    if with_depth and frame.depth is not None:
        # Half precision has no number for what is nearer than 15 micrometres.
        inverse = np.minimum(inverse_depth_in(frame.read_depth(), frame.depth_lens, frame.camera), np.float32(6e4))
    stored = _Stored(frame.camera, frame.read_image(), None if inverse is None else inverse.astype(np.float16))
    side = max(frame.camera.width, frame.camera.height)
    return stored if side <= longest_side else stored.scaled(longest_side / side)


def _shrunk(inverse: Float16[np.ndarray, "H W"], width: int, height: int) -> Float16[np.ndarray, "h w"]:
    """Return the mean of what was measured in each larger pixel; 0 where less than half of it was."""
    known = Image.fromarray((inverse > 0).astype(np.float32)).resize((width, height), Image.Resampling.BOX)
    mean = Image.fromarray(inverse.astype(np.float32)).resize((width, height), Image.Resampling.BOX)
    share = np.asarray(known)
    return np.where(share >= 0.5, np.asarray(mean) / np.maximum(share, 0.5), 0.0).astype(np.float16)
