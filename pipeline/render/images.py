"""Pictures made from renderings: displayable colours, and one number per pixel looked up by dominant Gaussian."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32, UInt8

from pipeline.render.rendering import Rendering


def color_image(rendering: Rendering) -> UInt8[np.ndarray, "H W 3"]:
    """Return the colours cut to 0..1, as 8-bit RGB.

    Raises:
        ValueError: The rendering has no colour.
    """
    if rendering.color is None:
        raise ValueError("this rendering has no colour: ask `render` for outputs=('color',)")
    return np.rint(np.clip(rendering.color, 0.0, 1.0) * 255.0).astype(np.uint8)


def category_image(dominant: Int32[np.ndarray, "H W"], category: Int32[np.ndarray, "M"]) -> Int32[np.ndarray, "H W"]:
    """Return the category of each pixel's dominant Gaussian; -1 where nothing contributes.

    Args:
        dominant: Gaussian index per pixel, -1 for none.
        category: Category per Gaussian.
    """
    if len(category) == 0:
        return np.full(dominant.shape, -1, np.int32)
    return np.where(dominant >= 0, category[np.maximum(dominant, 0)], np.int32(-1)).astype(np.int32, copy=False)
