"""Captures with a file for each frame's image, depth and pose: what the folder formats share.

A folder format says which files belong together, whose axes its poses use and what a step of depth means; the frames
are made here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pipeline.geometry import Camera, invert_rigid, nearest_rigid, opengl_to_opencv, validate_pose
from pipeline.scene.captures.capture import Frame, Skipped
from pipeline.scene.captures.image_files import DepthFile, ImageFile, image_size
from pipeline.scene.captures.views_file import camera_of
from schemas.errors import InputError
from schemas.storage import read_bytes


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsics and size of every image of a folder."""

    K: Float[np.ndarray, "3 3"]
    """Intrinsics in pixels."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""


@dataclass(frozen=True, slots=True)
class FrameFiles:
    """The files of one frame."""

    name: str
    """Frame name."""
    pose: str | None
    """Text file with a camera-to-world matrix; None where it is missing."""
    image: str | None = None
    """Photograph."""
    depth: str | None = None
    """Depth image."""


@dataclass(frozen=True, slots=True)
class DepthRule:
    """How a format writes depth."""

    unit_m: float
    """Metres of one step."""
    invalid: tuple[int, ...] = (0,)
    """Numbers that mean: no depth."""


def posed_frames(
    files: Sequence[FrameFiles], lens: Lens, depth_lens: Lens | None, depth: DepthRule, *, opengl: bool
) -> tuple[tuple[Frame, ...], tuple[Skipped, ...]]:
    """Return the frames whose pose can be used, and the others with the reason.

    Args:
        files: Files of each frame, in order.
        lens: Lens of the photographs.
        depth_lens: Lens of the depth images; None where it is the same.
        depth: How depth is written.
        opengl: Whether poses are in OpenGL axes (y up, looking down -z) instead of OpenCV's.

    Raises:
        InputError: A lens is not one.
    """
    frames, skipped = [], []
    for file in files:
        if file.pose is None:
            skipped.append(Skipped(file.name, "no pose", f"{file.image or file.depth}: no pose file beside it"))
            continue
        try:
            pose = _world_to_camera(file.pose, opengl)
        except InputError as error:
            skipped.append(Skipped(file.name, "broken pose", str(error)))
            continue
        frames.append(
            Frame(
                name=file.name,
                camera=_camera(lens, pose, file.pose),
                image=ImageFile(file.image) if file.image is not None else None,
                depth=DepthFile(file.depth, depth.unit_m, depth.invalid) if file.depth is not None else None,
                depth_camera=_camera(depth_lens, pose, file.pose) if depth_lens is not None else None,
            )
        )
    return tuple(frames), tuple(skipped)


def read_lens(uri: str, sample: str | None) -> Lens:
    """Return the lens of a text file with a 3x3 or 4x4 matrix.

    Args:
        uri: The text file.
        sample: An image it belongs to, for the size; None takes twice the principal point.

    Raises:
        InputError: A file is missing or wrong, or the principal point is not near the middle of the image.
    """
    K = read_matrix(uri)[:3, :3]
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise InputError(uri, field="intrinsics", expected="focal lengths above 0", found=(K[0, 0], K[1, 1]))
    if sample is None:
        width, height = round(2 * K[0, 2]), round(2 * K[1, 2])
    else:
        width, height = image_size(sample)
    # A matrix for another image size is the usual mistake, and it would shrink or stretch the whole scene.
    if not (0.35 * width < K[0, 2] < 0.65 * width and 0.35 * height < K[1, 2] < 0.65 * height):
        expected = f"a principal point near the middle of {width} x {height} pixels, the size of {sample}"
        raise InputError(uri, field="intrinsics", expected=expected, found=(float(K[0, 2]), float(K[1, 2])))
    return Lens(K, width, height)


def read_matrix(uri: str) -> Float[np.ndarray, "r c"]:
    """Return a text file's 3x3, 3x4 or 4x4 matrix; NaN and infinity are numbers here.

    Raises:
        InputError: The file is missing or holds something else.
    """
    try:
        rows = [
            [float(word) for word in line.split()] for line in read_bytes(uri).decode().splitlines() if line.strip()
        ]
        matrix = np.array(rows, np.float64)
    except (UnicodeDecodeError, ValueError) as error:
        raise InputError(uri, expected="a matrix of numbers", found=error) from error
    if matrix.shape not in ((3, 3), (3, 4), (4, 4)):
        raise InputError(uri, expected="3 x 3, 3 x 4 or 4 x 4 numbers", found=matrix.shape)
    return matrix


def _world_to_camera(uri: str, opengl: bool) -> Float[np.ndarray, "3 4"]:
    matrix = read_matrix(uri)
    if matrix.shape[1] != 4:
        raise InputError(uri, field="pose", expected="3 x 4 or 4 x 4 numbers", found=matrix.shape)
    pose = opengl_to_opencv(matrix) if opengl else matrix[:3]
    return invert_rigid(nearest_rigid(validate_pose(pose, uri)))


def _camera(lens: Lens, pose: Float[np.ndarray, "3 4"], subject: str) -> Camera:
    return camera_of(lens.K, pose, lens.width, lens.height, subject)
