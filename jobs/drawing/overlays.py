"""What is laid over a picture: per pixel, which group of Gaussians its dominant one belongs to, as a clear PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int32, UInt8

COLORS = ("#e8590c", "#1c7ed6", "#2f9e44", "#ae3ec9", "#f2b705", "#0ca6a6", "#e64980", "#7a5a2e")
"""One a cluster or instance, in order; they repeat. The page's style holds the same."""
TRUTH = "#ffffff"
"""Outline of ground truth."""
FILL, EDGE = 120, 255
"""Opacity of a group's pixels and of its outline, of 255."""


MOST = 15 * len(COLORS)
"""Groups told apart: a palette holds 256 colours, and each takes two."""


def groups_image(
    dominant: Int32[np.ndarray, "H W"], groups: Sequence[Int32[np.ndarray, "_"]], count: int
) -> UInt8[np.ndarray, "H W"]:
    """Return the group of each pixel's dominant Gaussian, counted from 1; 0 for none.

    Args:
        dominant: Gaussian a pixel, -1 for none.
        groups: Sets of Gaussians; of overlapping ones the first counts. After `MOST` the count begins anew.
        count: M.
    """
    owner = np.zeros(count + 1, np.uint8)  # -1 looks at the last place, which stays 0
    for number in range(len(groups), 0, -1):
        owner[groups[number - 1]] = (number - 1) % MOST + 1
    return owner[dominant]


def grown(mask: Bool[np.ndarray, "H W"], pixels: int) -> Bool[np.ndarray, "H W"]:
    """Return a mask with the pixels that are up to `pixels` steps away."""
    for _ in range(pixels):
        wide = mask.copy()
        wide[1:] |= mask[:-1]
        wide[:-1] |= mask[1:]
        wide[:, 1:] |= mask[:, :-1]
        wide[:, :-1] |= mask[:, 1:]
        mask = wide
    return mask


def outline(mask: Bool[np.ndarray, "H W"], pixels: int) -> Bool[np.ndarray, "H W"]:
    """Return the pixels just outside a mask; gaps of up to 4 pixels in it have no outline of their own."""
    padded = np.pad(mask, 4)
    closed = ~grown(~grown(padded, 2), 2)
    return (grown(closed, pixels) & ~closed)[4:-4, 4:-4]


def overlay(
    labels: UInt8[np.ndarray, "H W"],
    *,
    filled: int | None = None,
    truth: Bool[np.ndarray, "H W"] | None = None,
) -> bytes:
    """Return a PNG that is clear but for the groups.

    Args:
        labels: From `groups_image`.
        filled: The group that is filled, others being outlined alone; None fills all.
        truth: Pixels of the ground truth, outlined.
    """
    from PIL import Image

    edge = 2 if max(labels.shape) > 300 else 1
    image = np.zeros(labels.shape, np.uint8)
    shades: list[tuple[int, int, int, int]] = [(0, 0, 0, 0)]
    for label in np.unique(labels[labels > 0]):
        mask = labels == label
        color = rgb_of(int(label) - 1)
        own = filled in (None, label)
        for where, opacity in ((mask, FILL if own else 0), (outline(mask, edge if own else 1), EDGE)):
            image[where] = len(shades)
            shades.append((*color, opacity))
    if truth is not None and truth.any():
        for width, color in ((edge + 1, (0, 0, 0)), (edge, _rgb(TRUTH))):
            image[outline(truth, width)] = len(shades)
            shades.append((*color, EDGE))
    picture = Image.fromarray(image, "P")
    picture.putpalette([part for shade in shades for part in shade[:3]])
    sink = io.BytesIO()
    picture.save(sink, "PNG", transparency=bytes(shade[3] for shade in shades), optimize=True)
    return sink.getvalue()


def laid_over(color: UInt8[np.ndarray, "H W 3"], overlays: Sequence[bytes]) -> UInt8[np.ndarray, "H W 3"]:
    """Return a picture with overlays of its size on top, in order."""
    from PIL import Image

    picture = Image.fromarray(color).convert("RGBA")
    for mask in overlays:
        picture.alpha_composite(Image.open(io.BytesIO(mask)).convert("RGBA"))
    return np.asarray(picture.convert("RGB"))


def rgb_of(number: int) -> tuple[int, int, int]:
    """Return the colour of a cluster or instance."""
    return _rgb(COLORS[number % len(COLORS)])


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue
