"""Small renderings enlarged to the size that was asked for."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from jaxtyping import Float32, Int64

from pipeline.render.rendering import Rendering

_Image = TypeVar("_Image", bound=np.ndarray)


def enlarged(rendering: Rendering, width: int, height: int) -> Rendering:
    """Return a rendering of another size: colour and alpha bilinear, everything else from the nearest pixel.

    Depth is not interpolated: between two surfaces it would show one that is not there. Returns the rendering itself
    where its size is already right.
    """
    sizes = {
        image.shape[:2] for image in (getattr(rendering, name) for name in rendering.__slots__) if image is not None
    }
    if sizes == {(height, width)}:
        return rendering

    def nearest(image: _Image | None) -> _Image | None:
        if image is None:
            return None
        rows, columns = _nearest(image.shape[0], height), _nearest(image.shape[1], width)
        return image[rows][:, columns]

    return Rendering(
        color=None if rendering.color is None else bilinear(rendering.color, width, height),
        depth=nearest(rendering.depth),
        alpha=None if rendering.alpha is None else bilinear(rendering.alpha[..., None], width, height)[..., 0],
        dominant=nearest(rendering.dominant),
        dominant_weight=nearest(rendering.dominant_weight),
    )


def bilinear(image: Float32[np.ndarray, "h w c"], width: int, height: int) -> Float32[np.ndarray, "H W c"]:
    """Return the image at another size; pixel centres lie at +0.5, borders are repeated."""
    from pipeline.render.scaling_kernels import mix

    result = np.empty((height, width, image.shape[2]), np.float32)
    mix(np.ascontiguousarray(image), *_neighbours(image.shape[0], height), *_neighbours(image.shape[1], width), result)
    return result


def _nearest(small: int, large: int) -> Int64[np.ndarray, "n"]:
    return np.minimum(((np.arange(large) + 0.5) * small / large).astype(np.int64), small - 1)


def _neighbours(small: int, large: int) -> tuple[Int64[np.ndarray, "n"], Float32[np.ndarray, "n"]]:
    """Return, for each of `large` pixels, the first of the two of `small` it lies between and the second's share."""
    place = np.clip((np.arange(large) + 0.5) * small / large - 0.5, 0, small - 1)
    low = place.astype(np.int64)
    return low, (place - low).astype(np.float32)
