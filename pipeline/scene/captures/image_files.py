"""Photographs and depth images in files of their own."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO

import numpy as np
from jaxtyping import Float32, Integer, Num, UInt8

from schemas.errors import InputError
from schemas.storage import local_path, read_bytes

MILLIMETRE_M = 0.001


@dataclass(frozen=True, slots=True)
class ImageFile:
    """A photograph in any format pillow reads."""

    uri: str
    """Path or URI."""

    def read(self) -> UInt8[np.ndarray, "H W 3"]:
        """Return sRGB pixels.

        Raises:
            InputError: It is missing or no image.
        """
        return decode_image(read_bytes(self.uri), self.uri)


@dataclass(frozen=True, slots=True)
class DepthFile:
    """A 16-bit PNG of z-depth, or a NumPy file of it."""

    uri: str
    """Path or URI; a name that ends in .npy is a NumPy file."""
    unit_m: float = MILLIMETRE_M
    """Metres of one step of the file's numbers."""
    invalid: tuple[int, ...] = (0,)
    """Numbers that mean: no depth."""

    def read(self) -> Float32[np.ndarray, "h w"]:
        """Return z-depth in metres, 0 where there is none.

        Raises:
            InputError: It is missing, or is no 16-bit or floating image.
        """
        data = read_bytes(self.uri)
        steps = _numpy_image(data, self.uri) if self.uri.endswith(".npy") else _png_steps(data, self.uri)
        return depth_in_metres(steps, self.unit_m, self.invalid)


def depth_in_metres(
    steps: Num[np.ndarray, "h w"], unit_m: float, invalid: tuple[int, ...] = (0,)
) -> Float32[np.ndarray, "h w"]:
    """Return z-depth in metres, 0 where the number is one of `invalid`, not finite or not positive."""
    with np.errstate(invalid="ignore"):
        good = np.isfinite(steps) & (steps > 0)
        for number in invalid:
            good &= steps != number
        return np.where(good, steps * np.float32(unit_m), np.float32(0)).astype(np.float32, copy=False)


def decode_image(data: bytes, subject: str) -> UInt8[np.ndarray, "H W 3"]:
    """Return the sRGB pixels of an encoded image.

    Raises:
        InputError: The bytes are no image.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data)) as opened:
            return np.asarray(opened.convert("RGB"))
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise InputError(subject, expected="an image file", found=error) from error


def image_size(uri: str) -> tuple[int, int]:
    """Return width and height of an image or a NumPy file from its head alone.

    Raises:
        InputError: It is missing or no image.
    """
    from PIL import Image, UnidentifiedImageError

    path = local_path(uri)
    if uri.endswith(".npy"):
        height, width = _numpy_image(read_bytes(uri), uri).shape
        return width, height
    if path is not None and not path.is_file():
        raise InputError(uri, expected="an image file", found="nothing there")
    try:
        with Image.open(path if path is not None else BytesIO(read_bytes(uri))) as opened:
            return opened.size
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise InputError(uri, expected="an image file", found=error) from error


def _png_steps(data: bytes, subject: str) -> Integer[np.ndarray, "h w"]:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data)) as opened:
            mode, steps = opened.mode, np.asarray(opened)
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise InputError(subject, expected="a 16-bit PNG", found=error) from error
    if not mode.startswith("I"):
        raise InputError(subject, field="pixels", expected="one 16-bit channel (depth)", found=f"mode {mode}")
    return steps


def _numpy_image(data: bytes, subject: str) -> Num[np.ndarray, "h w"]:
    try:
        array = np.load(BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise InputError(subject, expected="a NumPy file of numbers", found=error) from error
    array = array[..., 0] if array.ndim == 3 and array.shape[-1] == 1 else array
    if array.ndim != 2 or array.dtype.kind not in "uif":
        raise InputError(
            subject, field="shape", expected="rows x columns of numbers", found=f"{array.shape} {array.dtype}"
        )
    return array
