"""COLMAP sparse models, text and binary: world-to-camera poses, already in OpenCV axes."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pipeline.geometry import quats_to_rotations, validate_pose
from pipeline.scene.captures.posed_files import Lens
from pipeline.scene.captures.views_file import Photographs, ViewsFile, camera_of, require_views, view_names
from pipeline.scene.views import View
from schemas.errors import InputError
from schemas.storage import exists, join, read_bytes

MODELS = {
    **{0: "SIMPLE_PINHOLE", 1: "PINHOLE", 2: "SIMPLE_RADIAL", 3: "RADIAL", 4: "OPENCV", 5: "OPENCV_FISHEYE"},
    **{6: "FULL_OPENCV", 7: "FOV", 8: "SIMPLE_RADIAL_FISHEYE", 9: "RADIAL_FISHEYE", 10: "THIN_PRISM_FISHEYE"},
}
"""Model names by the number binary files use."""

PARAMETERS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4}
"""Parameters of the models that are read; the others bend light, and renders here do not."""


@dataclass(frozen=True, slots=True)
class _Image:
    name: str
    camera_id: int
    quat: tuple[float, ...]
    translation: tuple[float, ...]


def read_colmap(folder: str, *, images: str | None = None, strict: bool = True) -> ViewsFile:
    """Return the views of a COLMAP model, ordered by image name.

    Args:
        folder: Path or URI of the folder with cameras and images, .bin (preferred) or .txt.
        images: Folder of the photographs; None when there are none.
        strict: Raise on the first unusable pose instead of skipping it.

    Raises:
        InputError: A file is missing or damaged, a camera model is not a pinhole, an image names no camera, or
            (strict: any, else every) pose is unusable.
    """
    folder = str(folder)
    suffix = next((s for s in (".bin", ".txt") if exists(join(folder, f"images{s}"))), None)
    if suffix is None:
        raise InputError(folder, field="images", expected="images.bin or images.txt", found="neither")
    cameras_at, images_at = join(folder, f"cameras{suffix}"), join(folder, f"images{suffix}")
    if suffix == ".bin":
        lenses = dict(_binary_lenses(_Bytes(read_bytes(cameras_at), cameras_at)))
        entries = list(_binary_images(_Bytes(read_bytes(images_at), images_at)))
    else:
        lenses = dict(_text_lenses(cameras_at))
        entries = list(_text_images(images_at))
    entries.sort(key=lambda image: image.name)
    photographs = Photographs(images) if images is not None else None
    views, skipped = [], []
    for image, name in zip(entries, view_names([image.name for image in entries]), strict=True):
        subject = f"{images_at} image {image.name}"
        if image.camera_id not in lenses:
            found = f"camera {image.camera_id}"
            raise InputError(subject, field="camera", expected=f"one of cameras {sorted(lenses)}", found=found)
        try:
            pose = _pose(image, subject)
        except InputError as error:
            if strict:
                raise
            skipped.append(str(error))
            continue
        lens = lenses[image.camera_id]
        camera = camera_of(lens.K, pose, lens.width, lens.height, subject)
        views.append(View(name, camera, photographs.find(image.name) if photographs else None))
    return require_views(ViewsFile(tuple(views), tuple(skipped)), images_at)


def _pose(image: _Image, subject: str) -> Float[np.ndarray, "3 4"]:
    quat, translation = np.array(image.quat), np.array(image.translation)
    if not np.isfinite(quat).all() or not quat.any():
        raise InputError(subject, field="pose", expected="a finite quaternion that is not zero", found=image.quat)
    return validate_pose(np.concatenate([quats_to_rotations(quat), translation[:, None]], axis=1), subject)


def _lens(model: str, width: int, height: int, parameters: tuple[float, ...], subject: str) -> Lens:
    if len(parameters) != PARAMETERS[model]:
        expected = f"{PARAMETERS[model]} parameters of {model}"
        raise InputError(subject, field="parameters", expected=expected, found=len(parameters))
    fx, fy, cx, cy = parameters if model == "PINHOLE" else (parameters[0], *parameters)
    return Lens(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), width, height)


def _require_pinhole(model: str, subject: str) -> None:
    if model not in PARAMETERS:
        expected = "PINHOLE or SIMPLE_PINHOLE: undistort the capture first (colmap image_undistorter)"
        raise InputError(subject, field="model", expected=expected, found=model)


def _lines(uri: str) -> list[tuple[int, str]]:
    """Return numbered lines without comments; empty ones stay, for images without points have one."""
    try:
        text = read_bytes(uri).decode()
    except UnicodeDecodeError as error:
        raise InputError(uri, expected="UTF-8 text", found=error) from error
    return [(i, line) for i, line in enumerate(text.splitlines(), 1) if not line.lstrip().startswith("#")]


def _text_lenses(uri: str) -> Iterator[tuple[int, Lens]]:
    for number, line in _lines(uri):
        words, subject = line.split(), f"{uri} line {number}"
        if not words:
            continue
        try:
            camera_id, model, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
            parameters = tuple(float(word) for word in words[4:])
        except (ValueError, IndexError) as error:
            expected = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS..."
            raise InputError(subject, expected=expected, found=repr(line[:80])) from error
        _require_pinhole(model, subject)
        yield camera_id, _lens(model, width, height, parameters, subject)


def _text_images(uri: str) -> Iterator[_Image]:
    lines = _lines(uri)
    start = next((i for i, (_, line) in enumerate(lines) if line.strip()), len(lines))
    # Every image has two lines, and the second, its points, may be empty.
    for number, line in lines[start::2]:
        words = line.split(maxsplit=9)
        if not words:
            continue
        try:
            pose = tuple(float(word) for word in words[1:8])
            yield _Image(words[9].strip(), int(words[8]), pose[:4], pose[4:])
        except (ValueError, IndexError) as error:
            expected = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
            raise InputError(f"{uri} line {number}", expected=expected, found=repr(line[:80])) from error


class _Bytes:
    """A cursor over a binary file that never reads past its end."""

    def __init__(self, data: bytes, subject: str) -> None:
        self.data, self.subject, self.at = data, subject, 0

    def integers(self, form: str) -> tuple[int, ...]:
        start = self.at
        self.skip(struct.calcsize("<" + form))
        return struct.unpack_from("<" + form, self.data, start)

    def doubles(self, count: int) -> tuple[float, ...]:
        start = self.at
        self.skip(8 * count)
        return struct.unpack_from(f"<{count}d", self.data, start)

    def skip(self, size: int) -> None:
        if self.at + size > len(self.data):
            raise self.short(size)
        self.at += size

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise self.short(1)
        self.at, start = end + 1, self.at
        return self.data[start:end].decode("utf-8", "replace")

    def short(self, size: int) -> InputError:
        found = f"{len(self.data) - self.at} bytes left of {len(self.data)}"
        return InputError(self.subject, expected=f"{size} bytes at byte {self.at}", found=found)


def _binary_lenses(data: _Bytes) -> Iterator[tuple[int, Lens]]:
    for _ in range(data.integers("Q")[0]):
        camera_id, code, width, height = data.integers("iiQQ")
        subject = f"{data.subject} camera {camera_id}"
        model = MODELS.get(code, f"model {code}")
        _require_pinhole(model, subject)
        yield camera_id, _lens(model, width, height, data.doubles(PARAMETERS[model]), subject)


def _binary_images(data: _Bytes) -> Iterator[_Image]:
    for _ in range(data.integers("Q")[0]):
        data.skip(4)
        pose = data.doubles(7)
        camera_id = data.integers("i")[0]
        name = data.text()
        data.skip(24 * data.integers("Q")[0])
        yield _Image(name, camera_id, pose[:4], pose[4:])
